// The height profile of a length, as a plot.

import uPlot from "uplot";
import { element } from "./elements";

/** Draw heights over the straight line into a box. label: of the distance along it. */
export function drawProfile(root: HTMLElement, title: string, label: string, [along, height]: [number[], number[]]): void {
  const soft = getComputedStyle(root).color;
  const axis = { stroke: soft, grid: { stroke: soft, width: 0.2 }, ticks: { show: false }, font: "12px system-ui" };
  const box = element("div", { class: "plot", role: "img", "aria-label": title });
  root.replaceChildren(element("h3", {}, title), box);
  new uPlot(
    {
      width: Math.max(root.clientWidth, 200),
      height: 158,
      scales: { x: { time: false } },
      legend: { show: false },
      cursor: { y: false },
      series: [{}, { stroke: soft, width: 1.5, points: { show: true, size: 4 } }],
      axes: [{ ...axis, size: 26, label, labelSize: 18, labelFont: axis.font }, { ...axis, size: 60 }],
    },
    [along, height],
    box,
  );
}
