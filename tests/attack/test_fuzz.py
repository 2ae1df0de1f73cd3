"""Damaged files of every kind that the program reads: each is taken, or refused in one line,
quickly and in little memory.
"""

import random
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import scipy.io
from bag_writers import LEFT, RIGHT, START_NS, STEP_NS, raw, write_bag
from calibration_texts import WHOLE_RIGS
from video_writers import write_pair

from calibration import CalibrationError, Camera, StereoRig
from calibration.formats import load_rig, write_rig
from stereo_seecolor.config import InputConfig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.errors import SeeColorError
from stereo_seecolor.extras.streams.bags.dive import open_dive
from stereo_seecolor.extras.streams.videos.motion import video_signals
from stereo_seecolor.files.ply import FACE, VERTEX, header, read_triangles, read_vertices
from stereo_seecolor.files.rasters import open_raster
from stereo_seecolor.files.tiff import encode_tiff
from stereo_seecolor.inputs.exposure_table import ExposureTable
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.inputs.video_file import video_file
from stereo_seecolor.inputs.video_frames import frame_path
from stereo_seecolor.inputs.video_streams import sound
from stereo_seecolor.mapping.marker_tables import read_bars, read_places
from stereo_seecolor.records import Water
from stereo_seecolor.run_folder.layout import Stage, state
from stereo_seecolor.run_folder.manifest import (
    DiveRecord,
    FrameRecord,
    InputRecord,
    Manifest,
    StageRecord,
)
from stereo_seecolor.run_folder.stamp import Stamp
from stereo_seecolor.run_folder.water_file import read_waters, waters_content

CASES = 420  # of each of the kinds below: well over 2,000 in all
SECONDS, BYTES = 1.5, 1 << 30
NUMBERS = [
    b"nan",
    b"-1",
    b"0",
    b"1e308",
    b"-1e400",
    b"inf",
    b"99999999999999999999",
    b"1e-320",
    b"~",
    b"[",
    b"{a: *x}",
    b"!!python/object:os.system",
]


@contextmanager
def bounded() -> Iterator[None]:
    """No more than a second and a half of a processor, and a gibibyte over what the process has
    now.
    """
    import resource

    def too_slow(*_: object) -> None:
        raise TimeoutError

    before = resource.getrlimit(resource.RLIMIT_AS)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    signal.signal(signal.SIGPROF, too_slow)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    resource.setrlimit(resource.RLIMIT_AS, (size + BYTES, before[1]))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        resource.setrlimit(resource.RLIMIT_AS, before)


def mutate(content: bytes, rng: random.Random) -> bytes:
    data = bytearray(content)
    for _ in range(rng.randint(1, 4)):
        place = rng.randrange(len(data) + 1)
        end = min(len(data), place + rng.randint(1, 40))
        match rng.randrange(10):
            case 0:
                data[place : place + 1] = bytes([rng.randrange(256)])
            case 1:
                del data[place:]
            case 2:
                del data[place:end]
            case 3:
                data[place:place] = data[place:end] * rng.randint(1, 50)
            case 4:
                data[place:end] = rng.randbytes(end - place)
            case 5:
                data[place:end] = rng.choice(NUMBERS)
            case 6 if len(data) > 8:
                data[place : place + 4] = rng.choice(
                    [b"\xff\xff\xff\xff", b"\x00\x00\x00\x00", b"\x7f\xff\xff\xff"]
                )
            case 7 | 8 | 9 as change:
                between = b"\n" if change == 7 else rng.choice((b" ", b",", b":"))
                data = bytearray(between.join(_changed(bytes(data).split(between), rng)))
    return bytes(data)


def _changed(parts: list[bytes], rng: random.Random) -> list[bytes]:
    """Lines or words, one of them gone, twice, or in the place of another."""
    one, other = (rng.randrange(len(parts)) for _ in range(2))
    match rng.randrange(4):
        case 0:
            del parts[one]
        case 1:
            parts.insert(other, parts[one])
        case 2:
            parts[one], parts[other] = parts[other], parts[one]
        case 3:
            parts[one:one] = [parts[one]] * 30
    return parts


def some_rig() -> StereoRig:
    K = np.array([[800.0, 0, 320], [0, 801, 240], [0, 0, 1]])
    T = np.eye(4)
    T[:3, 3] = -0.12, 0.001, 0.002
    camera = Camera(K, np.array([-0.1, 0.02, 0.001, 0, 0]), (640, 480))
    return StereoRig(camera, camera, T)


def images(folder: Path) -> list[Path]:
    rgb = np.random.default_rng(0).integers(0, 256, (24, 32, 3), dtype=np.uint8)
    cv2.imwrite(str(folder / "a.png"), rgb)
    cv2.imwrite(str(folder / "b.jpg"), rgb)
    cv2.imwrite(str(folder / "c.tiff"), rgb.astype(np.uint16) * 200)
    return sorted(folder.iterdir())


def range_maps(folder: Path) -> list[Path]:
    range_m = np.random.default_rng(0).uniform(0, 5, (24, 32)).astype(np.float32)
    cv2.imwrite(str(folder / "a.tiff"), range_m)
    cv2.imwrite(str(folder / "b.png"), (range_m * 1000).astype(np.uint16))
    (folder / "c.tif").write_bytes(encode_tiff(range_m.astype(np.float16)))
    (folder / "d.pfm").write_bytes(b"Pf\n32 24\n-1\n" + range_m.tobytes())
    np.save(folder / "e.npy", range_m)
    np.savez_compressed(folder / "f.npz", range_m)
    scipy.io.savemat(folder / "g.mat", {"range": range_m}, do_compression=True)
    with OpenEXR.File(
        {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, {"Z": range_m}
    ) as file:
        file.write(str(folder / "h.exr"))
    return sorted(folder.iterdir())


def calibrations(folder: Path) -> list[Path]:
    write_rig(some_rig(), folder / "native.yaml")
    write_rig(some_rig(), folder / "kalibr.yaml", "kalibr")
    write_rig(some_rig(), folder / "opencv.yaml", "opencv")
    (folder / "calib.txt").write_text(
        "cam0=[3997 0 1176; 0 3997 1011; 0 0 1]\ncam1=[3997 0 1307; 0 3997 1011; 0 0 1]\n"
        "doffs=131\nbaseline=193.001\nwidth=2964\nheight=1988\nndisp=280\n"
    )
    return [path for path in sorted(folder.iterdir()) if path.is_file()]


TEXT_RIG = (
    "Calibration report of rig B\nleft K: 478 0 289 0 478 220 0 0 1\nleft D: -0.1 0.02 0 0 0\n"
    "right K: 478 0 289 0 478 220 0 0 1\nright D: -0.1 0.02 0 0 0\n"
    "T_right_left: 1 0 0 -0.12 0 1 0 0 0 0 1 0 0 0 0 1\nmap: 1 0 0 -0.12 0 1 0 0 0 0 1 0 0 0 0 1\n"
)
HEADED_RIG = (
    "camera: GoPro 7\nleft:\nK 478 0 289 0 478 220 0 0 1\nD -0.1 0.02 0 0 0\nright:\n"
    "K 478 0 289 0 478 220 0 0 1\nD -0.1 0.02 0 0 0\n"
    "pose:\nR 1 0 0 0 1 0 0 0 1\nT -120 0 0\n"
)


def text_calibrations(folder: Path) -> list[Path]:
    """As all programs write them, and people."""
    for name, text in WHOLE_RIGS.items():
        (folder / f"{name}.txt").write_text(text)
    (folder / "named.txt").write_text(TEXT_RIG)
    (folder / "headed.txt").write_text(HEADED_RIG)
    (folder / "table.txt").write_text(
        "parameter,left,right\nfx,478,479\nfy,478,479\ncx,289,290\ncy,220,221\nk1,-.1,-.1\n"
        "k2,0.02,0.02\ntx,0,-0.12\nty,0,0\ntz,0,0\nrx,0,0\nry,0,0\nrz,0,0\n"
    )
    (folder / "anipose.toml").write_text(
        "".join(
            f"[cam_{i}]\nname = '{i}'\nsize = [640, 480]\n"
            "matrix = [[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]\n"
            f"distortions = [0.0, 0, 0, 0, 0]\nrotation = [0.0, 0, 0]\n"
            f"translation = [{-0.12 * i}, 0, 0]\n"
            for i in range(2)
        )
    )
    return sorted(folder.iterdir())


def configs(folder: Path) -> list[Path]:
    (folder / "run.yaml").write_text(
        "color:\n  lock: survey\n  median_luminance: 0.1\nmatching: {max_range_m: 7}\noutput:\n  "
        "preset: no-clouds\n"
    )
    return sorted(folder.iterdir())


def trajectories(folder: Path) -> list[Path]:
    (folder / "a.tum").write_text(
        "# t x y z\n" + "".join(f"{i}.5 {i * 0.1} 0.2 -1 0 0 0 1\n" for i in range(9))
    )
    (folder / "b.txt").write_text("".join(f"1 0 0 {i} 0 1 0 0 0 0 1 0\n" for i in range(9)))
    (folder / "c.txt").write_text(
        "# Image list\n"
        + "".join(f"{i} 1 0 0 0 {i} 0 0 1 im{i}.png\n1 2 -1\n" for i in range(1, 9))
    )
    (folder / "d.data").write_text(
        "% STEREO_POSE_FILE\n-23.5\n152.0\n"
        + "".join(f"{i} {i}.5 -23.5 152 {i} 2 3 0 0 1 L{i}.png R{i}.png 2 1 0\n" for i in range(9))
    )
    (folder / "e.xml").write_text(
        '<?xml version="1.0"?>\n<document>\n<chunk>\n<reference>GEOGCS["WGS '
        '84"]</reference>\n<transform>'
        "<rotation>1 0 0 0 1 0 0 0 1</rotation><translation>6378137 0 "
        "0</translation><scale>2</scale></transform>\n<cameras>\n"
        + "".join(
            f'<camera label="{i}"><transform>1 0 0 {i} 0 1 0 0 0 0 1 0 0 0 0 '
            "1</transform></camera>\n"
            for i in range(9)
        )
        + "</cameras>\n</chunk>\n</document>\n"
    )
    (folder / "f.txt").write_text(
        '# CoordinateSystem: GEOGCS["WGS '
        '84"]\n#Label,X/Longitude,Y/Latitude,Z/Altitude,Yaw,Pitch,Roll\n'
        + "".join(f"{i}.jpg,152.{i},-23.5,-5,10,1,2\n" for i in range(9))
    )
    return sorted(folder.iterdir())


def navigation(folder: Path) -> list[Path]:
    rows = "".join(f"2020-01-02T00:00:0{i},-23.5,152.{i},5,{i}0\n" for i in range(9))
    (folder / "nav.csv").write_text(f"t,lat,lon,d,h\n{rows}")
    return sorted(folder.iterdir())


def exposures(folder: Path) -> list[Path]:
    (folder / "log.csv").write_text(
        "name,exposure_ms,gain_db\n" + "".join(f"{i:04d}.png,{i + 1},3.5\n" for i in range(9))
    )
    return sorted(folder.iterdir())


def waters(folder: Path) -> list[Path]:
    (folder / "water.json").write_bytes(
        b"".join(waters_content({"a": Water(*np.random.default_rng(0).uniform(0, 1, (9, 3)))}))
    )
    return sorted(folder.iterdir())


def bars(folder: Path) -> list[Path]:
    (folder / "a.csv").write_text("first,second,length_m\n1,2,0.5\n2,3,0.51\n")
    (folder / "b.csv").write_text("#Label;Distance (m)\ntarget 1_target 2;0,5\n")
    return sorted(folder.iterdir())


def places(folder: Path) -> list[Path]:
    (folder / "a.csv").write_text("marker,x_m,y_m,z_m\n1,0,0,-8\n2,3,4,-8.5\n")
    (folder / "b.csv").write_text(
        "marker,lat,lon,depth_m,xyAcc,zAcc\n1,12.15,-68.28,8,.1,.1\n2,12.16,-68.28,9,.1,.1\n"
    )
    return sorted(folder.iterdir())


def meshes(folder: Path) -> list[Path]:
    vertices = np.zeros(3, VERTEX)
    vertices["position"] = np.eye(3)
    faces = np.zeros(1, FACE)
    faces["count"], faces["indices"] = 3, [0, 1, 2]
    (folder / "mesh.ply").write_bytes(
        header("made here", VERTEX, 3, 1) + vertices.tobytes() + faces.tobytes()
    )
    return sorted(folder.iterdir())


def rasters(folder: Path) -> list[Path]:
    import rasterio

    for name, more in (("a.tif", {}), ("b.tif", {"compress": "deflate", "predictor": 3})):
        with rasterio.open(
            folder / name, "w", driver="GTiff", width=64, height=64, count=1, dtype="float32",
            crs="EPSG:32755", transform=rasterio.Affine(0.01, 0, 0, 0, -0.01, 0), **more,
        ) as file:  # fmt: skip
            file.write(np.random.default_rng(0).uniform(0, 9, (1, 64, 64)).astype(np.float32))
    return sorted(folder.iterdir())


def read_raster(path: Path) -> None:
    with open_raster(path) as file:
        file.read(1)


def records(folder: Path) -> list[Path]:
    manifest = Manifest(folder)
    stamp = Stamp(4, 0, "0" * 16)
    files = {"range/damaged.tiff": (stamp,)}
    inputs = {"left": InputRecord("left/damaged.png", stamp, "0" * 64)}
    stages: dict[Stage, StageRecord] = {"range": StageRecord("k", facts={"known_percent": 80.0})}
    manifest.save_dive(DiveRecord({"dive": "a"}, files=files, waters={"*": "b"}))
    manifest.save_frame(FrameRecord("damaged", 1.5, inputs, stages, files))
    return sorted(path for path in folder.rglob("*.json"))


def read_record(path: Path) -> None:
    """As the record of a dive, and of one of its frames."""
    out = path.parent / "damaged-out"
    for name in ("manifest.json", "frames/damaged.json"):
        place = state(out, *name.split("/"))
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(path.read_bytes())
    Manifest(out).frame("damaged")
    if "version" in path.read_text(errors="replace"):
        Manifest(out).dive()


def bags(folder: Path) -> list[Path]:
    pixels = np.random.default_rng(0).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    sent = [
        raw(f"{camera}/image_raw", START_NS + i * STEP_NS, pixels, "rgb8")
        for i in range(3)
        for camera in (LEFT, RIGHT)
    ]
    return [write_bag(folder / f"b{suffix}", sent) for suffix in (".bag", ".db3", ".mcap")]


def read_bag(path: Path) -> None:
    """Every pair that there is."""
    for pair in open_dive(path, "", InputConfig()).pairing.pairs:
        read_image(pair.left)
        read_image(pair.right)


def videos(folder: Path) -> list[Path]:
    return list(write_pair(folder, 0.2, seconds=0.5, sound=True))


def read_video(path: Path) -> None:
    video_signals(path)
    sound(path)
    for number in range(0, len(video_file(path).index.pts), 4):
        read_image(frame_path(path, number))


KINDS: dict[str, tuple[Callable[[Path], list[Path]], Callable[[Path], object]]] = {
    "images": (images, read_image),
    "range maps": (range_maps, read_range_map),
    "calibrations": (calibrations, lambda path: load_rig(path, (640, 480))),
    "calibrations as text": (text_calibrations, lambda path: load_rig(path, (640, 480))),
    "configs": (configs, load_config),
    "trajectories": (trajectories, read_trajectory),
    "navigation": (
        navigation,
        lambda path: read_trajectory(Path(f"{path}:time=t,lat=lat,lon=lon,depth=d,heading=h")),
    ),
    "exposures": (exposures, ExposureTable.read),
    "bars": (bars, read_bars),
    "places": (places, read_places),
    "meshes": (meshes, lambda path: (read_vertices(path), read_triangles(path))),
    "rasters": (rasters, read_raster),
    "records": (records, read_record),
    "waters": (waters, lambda path: read_waters(path, ["a"])),
    "bags": (bags, read_bag),
    "videos": (videos, read_video),
}


# What hung a reader, or ended it with an error of another kind than its own.
FOUND = {
    "a row of numbers and a word": (
        "calibrations",
        f"frames: {' '.join(map(str, range(1021, 1061)))} used\n",
    ),
    "a heading that is a name with a text": (
        "calibrations",
        "body: GoPro\nbody:\nK 478 0 289 0 478 220 0 0 1\nright:\nK 478 0 289 0 478 220 0 0 1\n",
    ),
    "a transform of 14 numbers": (
        "calibrations",
        TEXT_RIG.replace("-0.12 0 1 0 0 0 0 1 0 0 0 0 1", "-0.12 0 1 0 0 0 0 1 0 0 0"),
    ),
    "numbers as keys": ("calibrations", "10: 1\n1: {1: [1]}\nK1: 3\n"),
    "a projection without depth": (
        "calibrations",
        "P0: 718 0 607 0 0 718 185 0 0 0 0 0\nP1: 718 0 607 -386 0 718 185 0 0 0 0 0\n",
    ),
    "a huge rotation vector": (
        "calibrations",
        TEXT_RIG.replace(
            "T_right_left: 1 0 0 -0.12 0 1 0 0 0 0 1 0 0 0 0 1", "R: 1e300 0 0\nT: 1 0 0"
        ),
    ),
    "a camera that is infinitely far": (
        "calibrations",
        "".join(
            f"[cam_{i}]\nname = '{i}'\nsize = [640, 480]\n"
            "matrix = [[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]\n"
            "distortions = [0.0, 0, 0, 0, 0]\nrotation = [0.0, 0, 0]\n"
            f"translation = [-{i}.12, 0, {i}e308]\n"
            for i in (0, 1)
        ),
    ),
    "a header and no rows": ("places", "marker,lat,lon,depth\n"),
    "a header of bars and no rows": ("bars", "first,second,length_m\n"),
    "a no-break space after a comment sign": ("bars", "#\xa0"),
}


@pytest.mark.posix
@pytest.mark.parametrize("case", FOUND)
def test_what_a_reader_did_not_bear(case: str, tmp_path: Path) -> None:
    kind, text = FOUND[case]
    (tmp_path / "damaged.txt").write_text(text)
    with bounded(), pytest.raises((SeeColorError, CalibrationError), match="damaged") as raised:
        KINDS[kind][1](tmp_path / "damaged.txt")
    assert "\n" not in str(raised.value)


@pytest.mark.posix
@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files(kind: str, tmp_path: Path) -> None:
    make, load = KINDS[kind]
    rng = random.Random(kind)
    (tmp_path / "whole").mkdir()
    seeds = make(tmp_path / "whole")
    for path in seeds:
        load(path)
    refused = 0
    for case in range(CASES):
        seed = seeds[case % len(seeds)]
        damaged = tmp_path / f"damaged{seed.suffix}"
        damaged.write_bytes(mutate(seed.read_bytes(), rng))
        try:
            with bounded():
                load(damaged)
        except (SeeColorError, CalibrationError) as error:
            refused += 1
            assert "\n" not in str(error), f"case {case}: more than one line"
            assert "damaged" in str(error), f"case {case}: the file is not named: {error}"
        except BaseException as error:
            kept = Path("/tmp") / f"crash-{kind.replace(' ', '-')}-{case}{seed.suffix}"
            kept.write_bytes(damaged.read_bytes())
            raise AssertionError(
                f"case {case} of {kind} ({kept}): {type(error).__name__}: {error}"
            ) from error
    assert refused > CASES // 10
