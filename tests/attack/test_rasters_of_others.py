"""A dem.tif or orthomosaic.tif of somebody else's opens no other file, and a damaged one is named
in one line.
"""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
from conftest import command

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.rasters import open_raster

VIRTUAL = """<VRTDataset rasterXSize="4" rasterYSize="4"><VRTRasterBand dataType="Float32" band="1"><SimpleSource>
<SourceFilename relativeToVRT="0">{}</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"""  # noqa: E501


def geotiff(path: Path, bands: int = 1) -> Path:
    with rasterio.open(path, "w", driver="GTiff", width=64, height=64, count=bands, dtype="float32",
    crs="EPSG:32755",
                       transform=rasterio.Affine(0.01, 0, 0, 0, -0.01, 0)) as file:  # fmt: skip
        file.write(np.full((bands, 64, 64), 7, np.float32))
    return path


@pytest.mark.parametrize(
    "source", ["other.tif", "/vsicurl/http://127.0.0.1:9/a.tif", "/vsizip/a.zip/b.tif"]
)
def test_a_virtual_raster_is_no_geotiff(tmp_path: Path, source: str) -> None:
    other = geotiff(tmp_path / "other.tif")
    path = tmp_path / "dem.tif"
    path.write_text(VIRTUAL.format(tmp_path / source if source == other.name else source))
    with (
        pytest.raises(InputError, match=r"dem\.tif: is damaged .*not recognized"),
        open_raster(path) as file,
    ):
        file.read(1)


def test_nothing_beside_a_raster_is_read(tmp_path: Path) -> None:
    path = geotiff(tmp_path / "dem.tif")
    (tmp_path / "dem.tif.aux.xml").write_text(
        "<PAMDataset><Metadata><MDI key='a'>b</MDI></Metadata></PAMDataset>"
    )
    geotiff(tmp_path / "dem.tif.ovr")
    with open_raster(path) as file:
        assert "a" not in file.tags() and file.overviews(1) == []
        assert [Path(name).name for name in file.files] == ["dem.tif"]


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _empty(path: Path) -> None:
    path.write_bytes(b"")


def _text(path: Path) -> None:
    path.write_text("no image")


def _virtual(path: Path) -> None:
    path.write_text(VIRTUAL.format("/etc/passwd"))


def _few_bands(path: Path) -> None:
    geotiff(path, 1)


@pytest.fixture(scope="module")
def broken_map(fused_dive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of a map, to be broken and mended."""
    return shutil.copytree(fused_dive / "out", tmp_path_factory.mktemp("broken") / "out")


@pytest.mark.slow
@pytest.mark.parametrize("damage", [_cut, _empty, _text, _virtual, _few_bands])
@pytest.mark.parametrize("name", ["orthomosaic.tif", "dem.tif"])
def test_each_command_names_a_damaged_raster(
    broken_map: Path, tmp_path: Path, name: str, damage: Callable[[Path], None]
) -> None:
    path = broken_map / "map" / name
    shutil.copy(path, tmp_path / "whole")
    damage(path)
    try:
        for words in (
            ["report", broken_map],
            ["export", broken_map, "--to", "taglab", "--out", tmp_path / "to"],
        ):
            code, said = command(*words)
            assert "Traceback" not in said
            if (damage, name) == (_few_bands, "dem.tif"):
                assert code == 0
            else:
                assert (code, name in said) in ((1, True), (3, True)), said
            if words[0] == "report":  # the page without that part
                page = (broken_map / "page" / "map" / "map.js").read_text()
                assert code in (0, 3)
                part = "mosaic" if name == "orthomosaic.tif" else "terrain"
                other = "terrain" if part == "mosaic" else "mosaic"
                assert f'"{other}"' in page and (code == 0) == (f'"{part}"' in page)
    finally:
        shutil.copy(tmp_path / "whole", path)


def test_no_other_place_opens_a_raster_to_read() -> None:
    package = Path(__file__).resolve().parents[2] / "stereo_seecolor"
    found = [
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if "rasterio.open(" in line and '"w"' not in line and '"r+"' not in line
    ]
    assert found == ["files/rasters.py"]
