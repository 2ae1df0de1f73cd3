"""The examples of docs/commands.md, in the order of the page. They run in the folder of a dive;
tests/docs/test_docs.py runs them.
"""

EXAMPLES: dict[str, tuple[str, ...]] = {
    "run": (
        "stereo-seecolor run --left left --right right --calib cam.yaml --out out",
        "stereo-seecolor run --left left --right right --calib cam.yaml --out survey --set "
        "color.lock=survey --json",
        "stereo-seecolor run --left left --right right --calib cam.yaml --out mapped --set "
        "color.lock=survey --poses trajectory.tum --fuse",
    ),
    "inspect": ("stereo-seecolor inspect left right cam.yaml",),
    "check": (
        "stereo-seecolor check --left left --right right --calib cam.yaml",
        "stereo-seecolor check --left left --right right --calib cam.yaml --refine refined.yaml",
    ),
    "view": ("stereo-seecolor view mapped  # opens the page in the browser",),
    "fuse": ("stereo-seecolor fuse survey --poses trajectory.tum",),
    "report": ("stereo-seecolor report survey",),
    "measure": ("stereo-seecolor measure survey points.csv",),
    "metrics": ("stereo-seecolor metrics mapped --out metrics",),
    "compare": ("stereo-seecolor compare mapped mapped --out change  # of two dives",),
    "markers": ("stereo-seecolor markers mapped --size 0.2  # the sample dive has no markers",),
    "export": (
        "stereo-seecolor export --list",
        "stereo-seecolor export mapped --to metashape --out metashape",
    ),
    "bag-info": ("stereo-seecolor bag-info dive.mcap  # the sample dive has no bag",),
    "sync": ("stereo-seecolor sync left.mp4 right.mp4  # the sample dive has no videos",),
    "live": (
        "stereo-seecolor live --left left --right right --calib cam.yaml --pairs 1  # without "
        "--pairs until Ctrl-C",
    ),
    "calibrate": (
        "stereo-seecolor calibrate --target chessboard:9x6:30mm --print-target board.pdf  # "
        "print the target",
        "stereo-seecolor calibrate --target chessboard:9x6:30mm --left board/left --right "
        "board/right --out rig.yaml",
    ),
    "convert-calib": ("stereo-seecolor convert-calib cam.yaml camchain.yaml --to kalibr",),
    "rectify": (
        "stereo-seecolor rectify --left left --right right --calib cam.yaml --out rectified",
    ),
    "range": ("stereo-seecolor range --left left --right right --calib cam.yaml --out ranges",),
    "correct": (
        "stereo-seecolor correct --images rectified/rectified_left --range ranges/range --out "
        "corrected",
    ),
    "water": (
        "stereo-seecolor water survey --poses trajectory.tum",
        "stereo-seecolor run --left left --right right --calib cam.yaml --out measured --water "
        "survey/water_measured.json",
    ),
    "evaluate": (
        "stereo-seecolor evaluate out --truth truth",
        "stereo-seecolor evaluate out --spread",
        "stereo-seecolor evaluate --chart --images rectified/rectified_left --range truth/range",
    ),
    "demo": ("stereo-seecolor demo --out demo",),
    "synthesize": (
        "stereo-seecolor synthesize --out turbid --pairs 2 --lines 1 --size 160x128 --water "
        "turbid --seed 3",
    ),
    "plan": ("stereo-seecolor plan --left left --right right --calib cam.yaml",),
    "campaign": ("stereo-seecolor campaign campaign.yaml",),
    "merge": (
        "stereo-seecolor run --left left --right right --calib cam.yaml --out parts/1 --shard 1/2",
        "stereo-seecolor run --left left --right right --calib cam.yaml --out parts/2 --shard 2/2",
        "stereo-seecolor merge parts/1 parts/2 --out whole",
    ),
    "status": ("stereo-seecolor status whole",),
    "doctor": ("stereo-seecolor doctor",),
    "config": (
        "stereo-seecolor config --show",
        "stereo-seecolor config --show --set color.lock=survey  # each value with its origin",
    ),
}
