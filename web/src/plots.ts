// Numbers over the dive, as plots with one cursor; a click opens the frame.

import uPlot from "uplot";
import { block } from "./blocks";
import type { Column, Dive, Text } from "./dive";
import { element, readable } from "./elements";

const HEIGHT_PX = 150;
const CHANNELS: Record<string, string> = { red: "--red", green: "--green", blue: "--blue" };
const FIRST = ["coverage", "median_range_m", "exposure"];

/** Draw all plots of the dive into a section. */
export async function drawPlots(section: HTMLElement, dive: Dive, text: Text, chosen: (name: string) => void): Promise<void> {
  section.append(element("h2", { class: "aside" }, text("plots.title")), element("p", { class: "hint" }, text("plots.hint")));
  const keys = Object.keys(dive.plots);
  const order = [...FIRST.filter((key) => keys.includes(key)), ...keys.filter((key) => !FIRST.includes(key) && key !== "seconds")];
  if (keys.includes("seconds")) order.push("seconds");
  const blocks = await Promise.all(dive.blocks.map((_, number) => block(number)));
  const curves = (key: string) => dive.plots[key].map((name): [string, Column] => [name, blocks.flatMap(({ plots }) => plots[key][name])]);
  const made = order.map((key) => drawPlot(section, key, curves(key), dive, text, chosen));
  const fit = () => made.forEach((plot) => plot.setSize({ width: section.clientWidth, height: HEIGHT_PX }));
  new ResizeObserver(fit).observe(section);
}

function drawPlot(section: HTMLElement, key: string, curves: [string, Column][], dive: Dive, text: Text, chosen: (name: string) => void): uPlot {
  const color = colorsOf(section);
  const lines = [color("--accent"), color("--green"), color("--blue"), color("--red"), color("--sand"), color("--soft")];
  const options: uPlot.Options = {
    width: section.clientWidth,
    height: HEIGHT_PX,
    scales: { x: { time: false } },
    cursor: { sync: { key: "dive" }, y: false },
    legend: { show: curves.length > 1, live: false },
    series: [
      { label: text("plots.frame") },
      ...curves.map(([name], i) => ({
        label: text(name in CHANNELS ? `channel.${name}` : name),
        stroke: name in CHANNELS ? color(CHANNELS[name]) : lines[i % lines.length],
        width: 1.5,
        points: { show: dive.names.length < 60, size: 4 },
      })),
    ],
    axes: [
      { stroke: color("--soft"), grid: { stroke: color("--line"), width: 1 }, ticks: { show: false }, size: 24, font: "12px system-ui", label: text("plots.frame"), labelSize: 18, labelFont: "12px system-ui" },
      { stroke: color("--soft"), grid: { stroke: color("--line"), width: 1 }, ticks: { show: false }, size: 64, font: "12px system-ui", values: (_, marks) => marks.map((mark) => (mark === null ? "" : readable(mark))) },
    ],
  };
  const title = text(`plots.${key}`);
  const box = element("div", { class: "plot", role: "img", "aria-label": `${title}. ${summary(curves.map(([, column]) => column))}` });
  section.append(element("h3", {}, title), box);
  const data = [dive.names.map((_, i) => i), ...curves.map(([, column]) => column)] as uPlot.AlignedData;
  const plot = new uPlot(options, data, box);
  plot.over.addEventListener("click", (event) => chosen(dive.names[plot.posToIdx(event.offsetX)]));
  return plot;
}

/** The page's colors as a canvas takes them. */
function colorsOf(section: HTMLElement): (name: string) => string {
  const probe = section.appendChild(element("span"));
  const names = ["--accent", "--red", "--green", "--blue", "--sand", "--soft", "--line"];
  const colors = new Map(names.map((name) => [name, ((probe.style.color = `var(${name})`), getComputedStyle(probe).color)]));
  probe.remove();
  return (name) => colors.get(name) ?? "";
}

function summary(columns: Column[]): string {
  const known = columns.flat().filter((value): value is number => value !== null);
  let low = Infinity;
  let high = -Infinity;
  for (const value of known) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return known.length ? `${readable(low)} – ${readable(high)}` : "";
}
