"""Logs and models that hold a track and are not read here, recognized so that the error says what
the file is and what to do.
"""

import re

_BINARY = (
    (rb"PK\x03\x04", "a spreadsheet or an archive: save the table as CSV, or unpack it"),
    (
        rb"ULog\x01\x12\x35",
        "a log of PX4 (ULog): convert it with ulog2csv, and give a table with time, lat, lon, "
        "depth and heading",
    ),
    (rb"\xa3\x95", "a log of ArduPilot (DataFlash): convert it with mavlogdump.py --format csv"),
    (
        rb".{8}[\xfd\xfe].{5}",
        "a telemetry log of MAVLink (tlog): convert it with mavlogdump.py --format csv, or "
        "export it as CSV",
    ),
    (rb"\x00\x00\x27\x0a", "a Shapefile: export the track as CSV, with time, lat and lon"),
)
_TEXT = (
    (
        r"\A# Bundle file",
        "a model of Bundler, without names or times of images: export it as images.txt of COLMAP",
    ),
    (
        r"\Aversion https://git-lfs",
        "a pointer of Git LFS in place of the file: fetch it with git lfs pull",
    ),
    (r"\ANVM_V3", "a model of VisualSFM: export it as images.txt of COLMAP"),
    (
        r'"img_name"\s*:',
        "the cameras of a splatting model: give the images.txt of COLMAP that it was made from",
    ),
    (
        r'"type"\s*:\s*"FeatureCollection"',
        "a GeoJSON file: export the track as CSV, with time, lat and lon",
    ),
    (
        r"\$PSONLLD,",
        "a log of a Sonardyne USBL (PSONLLD), whose times have no date: log ZDA or RMC beside it, "
        "or save it as CSV with time, lat, lon, depth",
    ),
    (
        r"\$PSIMLBP,",
        "a log of a Kongsberg HiPAP (PSIMLBP), without a date: save it as CSV with time, lat, lon, "
        "depth",
    ),
    (
        r"\$PSIMSSB,",
        "a log of a Kongsberg HiPAP (PSIMSSB), in meters from the ship and without a date: save "
        "it as CSV with time, lat, lon, depth, made with the position and heading of the ship",
    ),
    (
        r"\bUSBL(LONG|ANGLES),",
        "a log of an Evologics USBL, in meters from the ship: save it as CSV with time, lat, lon, "
        "depth, made with the position and heading of the ship",
    ),
    (
        r"\AFMT, *\d+, *\d+, *FMT",
        "a log of ArduPilot as text: convert the .BIN with mavlogdump.py --format csv",
    ),
    (
        r"\A\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d+: \w+ \{",
        "the text that mavlogdump.py prints: give it --format csv, and one message a file "
        "(--types GLOBAL_POSITION_INT, then ATTITUDE)",
    ),
    (r"\A(FTP NEW|HSX)", "raw data of Hypack: export the track as CSV, with time, lat, lon, depth"),
    (
        r"(?m)^(:SA,|\$PNOR|wr[zptu],)",
        "a log of a DVL, of velocities: give the vehicle's track, as CSV with time, lat and lon "
        "(or north and east), depth, heading",
    ),
    (
        r"<uddf|<divelog|\A\* Sea-Bird|\A#B\s+Created:",
        "a log of depths without positions: save it as CSV with time and depth, and give it beside "
        "positions and headings, position.csv,attitude.csv,depth.csv",
    ),
    (
        r"(?m)^header: *\n *(seq|stamp):",
        "the text of rostopic echo: give the bag itself, or what rostopic echo -p writes",
    ),
    (
        r"\A\d{9,10},\d{1,9},[a-zA-Z]",
        "the rows of ros2 topic echo --csv, without names of columns: give the bag itself",
    ),
    (
        r"\A(EPSG:\d+|WGS84 UTM|\+proj)",
        "positions of images for OpenDroneMap (geo.txt): give its reconstruction.json, or CSV with "
        "name, lat, lon, depth, heading",
    ),
    (
        r"(?i)omega[\s,;]+phi[\s,;]+kappa",
        "positions of cameras with omega, phi, kappa: export the cameras of Metashape as XML, or "
        "the model as COLMAP's images.txt",
    ),
    (r"<kml", "a KML file without times: give GPX, or CSV with time, lat and lon"),
    (
        r"\A(\s|#.*\n|version\s*:.*\n)*(origin|mission|vehicle)\s*:",
        "a mission file of oplab: give the csv/ekf table of the camera",
    ),
)


def named_by_begin(raw: bytes) -> str | None:
    """Name a binary log by its first bytes, with what to do; None for others."""
    return next((what for begin, what in _BINARY if re.match(begin, raw[:64], re.DOTALL)), None)


def named(text: str) -> str | None:
    """Name a text file that is not read as a trajectory, with what to do; None for others."""
    return next((what for pattern, what in _TEXT if re.search(pattern, text[:4000])), None)
