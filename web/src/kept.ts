// A measure, and random points, as the browser and OUT/measures.json keep it (stereo_seecolor/report/kept_measures.py).

/** A point of the map that is labelled, "" as long as it is not; in the map's own coordinates. */
export interface LabelledSpot {
  spot_m: [number, number];
  label: string;
}

export interface KeptPoints {
  changed_ms: number; // when one was labelled last, or they were placed
  points: LabelledSpot[];
}

export type Kind = "point" | "length" | "area";

/**
 * places: pixels of the rectified left image. points: the same in its camera, meters. value, std: meters or square meters.
 * On the map, frame is "", places are empty and points in the map's own coordinates; clicks_m: how well each was hit.
 */
export interface Measure {
  id: number;
  key?: string; // the same in every browser
  changed_ms?: number; // when it was measured or changed last
  frame: string;
  map?: string;
  kind: Kind;
  label: string;
  note?: string;
  places: [number, number][];
  points: number[][];
  clicks_m?: number[];
  value: number;
  std: number;
  known?: number; // fraction of an outline in which the surface is known
  surface: number | null;
  surface_std: number | null;
  volume_l?: number | null; // of an area on the map: above the ground around it
  volume_std_l?: number | null;
}
