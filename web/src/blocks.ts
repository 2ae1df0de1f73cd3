// Poses and plots of the frames: a thousand to a script, loaded when they are asked for (stereo_seecolor/report/frame_blocks.py).

import { fromText } from "./codes";
import type { Block, Dive, Pose } from "./dive";
import { script } from "./scripts";

const FRAMES = 1000;

const kept = new Map<number, Promise<Block>>();
const waiting = new Map<number, (packed: Packed) => void>();

interface Packed {
  poses: string;
  plots: Block["plots"];
}

/** What the scripts of page/frames call. */
export function receiveBlock(number: number, packed: Packed): void {
  waiting.get(number)?.(packed);
}

let source = keptBlock;

/** page.js and map.js are two programs: the latter takes what the former holds. */
export function takeBlocks(from: (number: number) => Promise<Block>): void {
  source = from;
}

export function block(number: number): Promise<Block> {
  return source(number);
}

function keptBlock(number: number): Promise<Block> {
  const made = kept.get(number) ?? load(number);
  kept.set(number, made);
  made.catch(() => kept.delete(number));
  return made;
}

async function load(number: number): Promise<Block> {
  const packed = await new Promise<Packed>((resolve, reject) => {
    waiting.set(number, resolve);
    script(`page/frames/${number}.js`).catch(reject);
  });
  const poses = new Float32Array(fromText(packed.poses).buffer);
  const pose = (place: number) => (Number.isFinite(poses[12 * place]) ? [...poses.subarray(12 * place, 12 * place + 12)] : null);
  return { pose, plots: packed.plots };
}

/** The block of a frame, and its number there. */
export function placeOf(frame: number): [number, number] {
  return [Math.floor(frame / FRAMES), frame % FRAMES];
}

/** Names of the frames of a block that are in the map, with their poses. */
export async function posesOf(dive: Dive, number: number): Promise<[string, Pose][]> {
  const { pose } = await block(number);
  const names = dive.names.slice(number * FRAMES, (number + 1) * FRAMES);
  return names.flatMap((name, place): [string, Pose][] => {
    const found = pose(place);
    return found ? [[name, found]] : [];
  });
}

/** The pose of a frame in the map; null without one. */
export async function poseOf(dive: Dive, name: string): Promise<Pose | null> {
  const frame = dive.names.indexOf(name);
  const [number, place] = placeOf(frame);
  return frame >= 0 && dive.blocks[number] ? (await block(number)).pose(place) : null;
}
