// The map as page/map/map.js hands it over (stereo_seecolor/report/map_files.py).

/** Size of a raster in pixels, and where its upper left corner lies in the world. */
export interface Place {
  width: number;
  height: number;
  west_m: number;
  north_m: number;
  pixel_m: number;
}

/**
 * A piece of the mesh. cell_m: how fine it is. finer: the pieces that show the same at half of that.
 * texel_m, texels: how fine its texture is, and how many pixels it has; without one its vertices have colors.
 */
export interface Piece {
  low_m: number[];
  high_m: number[];
  triangles: number;
  cell_m: number;
  texel_m?: number;
  texels?: number;
  finer: string[]; // which the script of this piece lists, or this list
}

/** Metrics of squares, whose numbers are loaded once they are looked at; heights are averaged over cells of scale_m. */
export interface Squares {
  edge_m: number;
  scale_m: number;
  names: string[];
}

export interface About {
  id: string;
  pieces: Record<string, Piece>; // with the colors of the camera where there are images on the surface; below no other: those are added once they are known
  textured?: Record<string, Piece>; // the images on the surface; the coarsest piece has the colors of its vertices
  mosaic?: Place;
  raw?: Place;
  gaps?: Place; // of the hatch over what has no height
  terrain?: Place & { low_m: number; high_m: number; tiles: string[]; std_m: number; correlation_m: number }; // over which errors of heights are alike
  squares?: Squares;
  preview: string;
  offset_m: number[];
  range_scale: number; // of the frames' own ranges, to those of the map
}
