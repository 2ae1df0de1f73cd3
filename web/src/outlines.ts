// Planes through points, and outlines in a plane: what frames and map share.

export type Vector = [number, number, number];
export type Flat = [number, number];

/**
 * Value at (0, 0) and slopes of the least-squares plane through (x, y, value); the mean, flat, where there are fewer points than `least`,
 * or their normal equations' determinant is not above `leastDeterminant` of their number and mean squared size.
 */
export function planeThrough(cells: Vector[], least: number, leastDeterminant: (n: number, size: number) => number): Vector {
  let [n, sx, sy, sxx, sxy, syy, sv, sxv, syv] = [0, 0, 0, 0, 0, 0, 0, 0, 0];
  for (const [x, y, value] of cells) {
    n += 1;
    sx += x;
    sy += y;
    sxx += x * x;
    sxy += x * y;
    syy += y * y;
    sv += value;
    sxv += x * value;
    syv += y * value;
  }
  const det = n * (sxx * syy - sxy * sxy) - sx * (sx * syy - sxy * sy) + sy * (sx * sxy - sxx * sy);
  if (n < least || !(det > leastDeterminant(n, (sxx + syy) / n))) return [sv / n, 0, 0];
  return [
    (sv * (sxx * syy - sxy * sxy) - sx * (sxv * syy - sxy * syv) + sy * (sxv * sxy - sxx * syv)) / det,
    (n * (sxv * syy - sxy * syv) - sv * (sx * syy - sxy * sy) + sy * (sx * syv - sxv * sy)) / det,
    (n * (sxx * syv - sxv * sxy) - sx * (sx * syv - sxv * sy) + sv * (sx * sxy - sxx * sy)) / det,
  ];
}

/** Area of a polygon, whichever way round it runs. */
export function polygonArea(outline: readonly (readonly number[])[]): number {
  const next = (i: number) => outline[(i + 1) % outline.length];
  return Math.abs(outline.reduce((sum, [x, y], i) => sum + x * next(i)[1] - y * next(i)[0], 0)) / 2;
}

/** Whether a place lies in a polygon. */
export function inside(outline: readonly Flat[], x: number, y: number): boolean {
  let found = false;
  outline.forEach(([ax, ay], i) => {
    const [bx, by] = outline[(i + 1) % outline.length];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) found = !found;
  });
  return found;
}

/** Whether two sides of a polygon that share no corner cross. */
export function crossesItself(outline: readonly Flat[]): boolean {
  const end = (i: number) => outline[(i + 1) % outline.length];
  return outline.some((a, i) =>
    outline.some((c, j) => j >= i + 2 && !(i === 0 && j === outline.length - 1) && cross2(a, end(i), c, end(j))),
  );
}

const side = (a: Flat, b: Flat, p: Flat) => (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
const cross2 = (a: Flat, b: Flat, c: Flat, d: Flat) => side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0;
