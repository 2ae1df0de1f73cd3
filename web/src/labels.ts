// Labels of what covers the bottom, by the names that annotation programs use.

import { element } from "./elements";

/** CATAMI: classes of the classification scheme (Althaus et al. 2015, PLoS ONE 10:e0141039). CoralNet: its functional groups, and labels that many of its sources share. */
export const LABELS: Record<string, string[]> = {
  CATAMI: [
    ...["Branching", "Columnar", "Corymbose", "Digitate", "Encrusting", "Foliose / plate", "Free-living", "Massive", "Sub-massive", "Tabulate"].map((form) => `Stony corals: ${form}`),
    ...["Black & octocorals", "Corals: Bleached", "Hydroids", "True anemones", "Sponges: Crusts", "Sponges: Massive forms", "Sponges: Erect forms", "Sponges: Hollow forms"],
    ...["Encrusting: Calcareous", "Articulated calcareous", "Erect coarse branching", "Erect fine branching", "Filamentous / filiform", "Globose / saccate", "Large canopy-forming", "Laminate", "Sheet-like / membraneous"].map((form) => `Macroalgae: ${form}`),
    ...["Seagrasses", "Ascidians", "Bryozoa", "Echinoderms", "Molluscs", "Worms", "Fishes"],
    ...["Rock", "Boulders", "Cobbles"].map((kind) => `Consolidated (hard): ${kind}`),
    ...["Sand / mud", "Pebble / gravel", "Biogenic: Rubble"].map((kind) => `Unconsolidated (soft): ${kind}`),
    "Unscorable",
  ],
  CoralNet: ["Hard coral", "Bleached hard coral", "Recently dead coral", "Soft coral", "CCA", "Turf algae", "Macroalgae", "Seagrass", "Sponge", "Other Invertebrates", "Hard Substrate", "Soft Substrate", "Sand", "Rubble", "Unclear", "Other"],
};

/** A list that inputs with ``list=id`` offer. */
export function labelList(id: string, labels: string[]): HTMLDataListElement {
  return element("datalist", { id }, ...labels.map((value) => element("option", { value })));
}
