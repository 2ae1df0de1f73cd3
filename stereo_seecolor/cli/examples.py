"""Examples in the help of each command, as a user types them."""

SIDES = "--left left --right right --calib cam.yaml"
PROGRAM = "stereo-seecolor"

EXAMPLES = {
    "inspect": ("inspect DIVE", "inspect left right stereo.mat"),
    "run": (
        f"run {SIDES} --out OUT",
        f"run {SIDES} --fuse",
        f"run {SIDES} --refine --fuse --poses nav.tum",
        f"run {SIDES} --water EARLIER/water.json",
        "run --bag dive.mcap --out OUT",
        "run --left a.mp4 --right b.mp4 --calib cam.yaml --out OUT",
    ),
    "live": (f"live {SIDES} --port 8080", "live --bag dive.mcap --port 8080"),
    "sync": ("sync left.mp4 right.mp4",),
    "bag-info": ("bag-info dive.mcap", "bag-info BAG --topics left=/fwd/image,right=/aft/image"),
    "correct": ("correct --images IMAGES --range RANGES --out OUT",),
    "range": (f"range {SIDES} --set matching.max_range_m=8",),
    "rectify": (f"rectify {SIDES} --out OUT",),
    "fuse": ("fuse OUT", "fuse OUT --poses nav.tum --set mapping.voxel_m=0.005"),
    "report": ("report OUT",),
    "measure": ("measure OUT points.csv", "measure OUT points.csv > lengths.csv"),
    "view": ("view OUT", "view OUT --window"),
    "metrics": ("metrics OUT", "metrics OUT --polygons corals.geojson --out METRICS"),
    "compare": ("compare 2024 2025 --out CHANGE",),
    "markers": ("markers OUT --size 0.2", "markers OUT --bars bars.csv --points surveyed.csv --out MARKERS"),
    "export": ("export --list", "export OUT --to colmap --out COLMAP"),
    "demo": ("demo --out demo",),
    "synthesize": ("synthesize --out dive --pairs 20 --lines 2 --water turbid",),
    "evaluate": (
        "evaluate OUT --truth dive/truth",
        "evaluate OUT --spread",
        "evaluate --chart --images IMAGES --range RANGES",
        "evaluate --chart --images IMAGES --range RANGES --others SEATHRU",
    ),
    "calibrate": (
        "calibrate --target chessboard:9x6:24mm --print-target board.pdf",
        "calibrate --target chessboard:9x6:24mm --left BOARD/left --right BOARD/right",
    ),
    "check": (f"check {SIDES}", f"check {SIDES} --refine refined.yaml"),
    "convert-calib": (
        "convert-calib stereo.mat cam.yaml",
        "convert-calib cam.yaml ROS --to ros",
        "convert-calib camchain.yaml cam.yaml",
    ),
    "water": ("water OUT --poses nav.tum", "water OUT --chart"),
    "campaign": ("campaign campaign.yaml", "campaign campaign.yaml --only-failed"),
    "plan": (f"plan {SIDES}",),
    "merge": ("merge PARTS/1 PARTS/2 --out OUT", "merge PARTS/1 PARTS/2 --out OUT --fit-only"),
    "status": ("status OUT", "status PARTS/1 PARTS/2"),
    "config": ("config --show --set color.lock=survey", "config --config OUT/run.json > settings.yaml"),
    "doctor": ("doctor",),
}
"""Command -> what follows the program's name. Names in capitals are folders."""


def epilog(command: str) -> str:
    """The examples of a command as paragraphs, each of which typer prints on a line of its own."""
    return "\n\n".join(["Examples:", *(f"  {PROGRAM} {words}" for words in EXAMPLES[command])])
