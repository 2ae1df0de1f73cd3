// A perceptually even color map: lightness rises in equal steps through blue, green and yellow (Oklab, B. Ottosson 2020).

const STEPS = 256;

/** RGB, 0 to 255, of 256 steps. */
export const COLORS: Uint8ClampedArray = ramp();

/** The color of a fraction 0 to 1, as CSS writes it. */
export function css(fraction: number): string {
  const i = 3 * Math.round(Math.min(Math.max(fraction, 0), 1) * (STEPS - 1));
  return `rgb(${COLORS[i]} ${COLORS[i + 1]} ${COLORS[i + 2]})`;
}

function ramp(): Uint8ClampedArray {
  const colors = new Uint8ClampedArray(3 * STEPS);
  for (let i = 0; i < STEPS; i++) {
    const t = i / (STEPS - 1);
    colors.set(srgb(0.28 + 0.66 * t, 0.11 + 0.05 * Math.sin(Math.PI * t), ((300 - 195 * t) * Math.PI) / 180), 3 * i);
  }
  return colors;
}

function srgb(lightness: number, chroma: number, hue: number): number[] {
  const a = chroma * Math.cos(hue);
  const b = chroma * Math.sin(hue);
  const l = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (lightness - 0.0894841775 * a - 1.291485548 * b) ** 3;
  const linear = [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
    -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
  ];
  return linear.map((x) => 255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055));
}
