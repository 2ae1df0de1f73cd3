// Triangles of a mesh from the steps of a walk over it (stereo_seecolor/report/mesh_code.py).

const [NEW, BEFORE, AFTER, NONE, FAR] = [0, 1, 2, 3, 4];

/** indices: of the corners of all triangles. beside: of each vertex the one that its values differ from, -1 for the first. */
export interface Walked {
  indices: Uint32Array;
  beside: Int32Array;
}

/** Walk over a mesh of so many vertices and triangles. steps: three a byte. far: numbers of vertices, of three bytes each. */
export function walked(steps: Uint8Array, far: Uint8Array, vertices: number, triangles: number): Walked {
  const indices = new Uint32Array(3 * triangles);
  const beside = new Int32Array(vertices);
  const [start, end, previous, next] = Array.from({ length: 4 }, () => new Int32Array(3 * triangles)); // of edges around what is walked
  const closed = new Uint8Array(3 * triangles);
  const first = new Int32Array(vertices); // the edge that starts at a vertex
  const names = far.length / 3;
  let [met, named, stepped, three, count, filled] = [0, 0, 0, 0, 0, 0];
  const name = () => met - (far[named] | (far[names + named] << 8) | (far[2 * names + named++] << 16));
  const join = (one: number, other: number) => {
    next[one] = other;
    previous[other] = one;
  };
  const add = (from: number, to: number) => {
    start[count] = from;
    end[count] = to;
    first[from] = count;
    return count++;
  };
  for (let edge = 0; filled < indices.length; edge++) {
    if (edge === count) {
      // a part that nothing joins to what is walked
      const corners = [0, 1, 2].map(() => {
        const corner = name();
        if (corner === met) beside[met] = met++ - 1;
        return corner;
      });
      corners.forEach((corner, k) => add(corner, corners[(k + 1) % 3]));
      for (let k = 0; k < 3; k++) join(edge + k, edge + ((k + 1) % 3));
      indices.set(corners, filled);
      filled += 3;
    }
    if (closed[edge]) continue;
    if (stepped % 3 === 0) three = steps[stepped / 3];
    const step = three % 5;
    three = (three / 5) | 0;
    stepped++;
    if (step === NONE) continue;
    let before = previous[edge];
    let after = next[edge];
    let corner = met;
    if (step === NEW) beside[met++] = end[edge];
    else if (step === FAR) corner = name();
    else {
      const gone = step === BEFORE ? before : after;
      closed[gone] = 1;
      corner = step === BEFORE ? start[gone] : end[gone];
      if (step === BEFORE) before = previous[gone];
      else after = next[gone];
    }
    indices[filled++] = end[edge];
    indices[filled++] = start[edge];
    indices[filled++] = corner;
    const other = first[corner];
    const to = step === BEFORE ? count : add(start[edge], corner);
    const out = step === AFTER ? to : add(corner, end[edge]);
    join(before, to);
    join(out, after);
    if (step === NEW) join(to, out);
    else if (step === FAR) {
      // the ring of edges parts, or joins another
      const last = previous[other];
      join(to, other);
      join(last, out);
    }
  }
  return { indices, beside };
}
