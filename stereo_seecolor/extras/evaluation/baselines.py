"""Other color methods for comparison, implemented from their papers.

Every method takes an image as displayed, (H, W, 3) float64 in [0, 1], with a range map (H, W) in
meters, NaN where unknown, and returns (H, W, 3) float64 in the same encoding, not clipped, NaN
where it has no result. ``expose`` sets all to one exposure.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.listing import list_images
from stereo_seecolor.records import Image

Array = NDArray[np.float64]
Method = Callable[[Array, Array], Array]

# of the pixels of each channel that become black, and white: the usual contrast stretch
STRETCHED_FRACTION = 0.01
# darkest pixels of each bin of range (Akkaynak and Treibitz, CVPR 2019)
DARK_FRACTION, DARK_BINS = (0.01, 10)
CLIPPED_FRACTION = 0.0005  # of the pixels at full scale, at most 1 in 2000
LEAST_ATTENUATION = 1e-3  # 1/m: below, a logarithm of a ratio is noise
_GRID_WIDTH, _AVERAGING_STEPS = 160, 600  # pixels, and steps of the local averaging of Sea-thru


def raw(image: Array, range_m: Array) -> Array:
    """The image unchanged."""
    return image


def contrast_stretch(image: Array, range_m: Array) -> Array:
    """Each channel stretched from its darkest to its brightest hundredth, and clipped."""
    low, high = np.quantile(
        image.reshape(-1, 3), [STRETCHED_FRACTION, 1 - STRETCHED_FRACTION], axis=0
    )
    return np.asarray(np.clip((image - low) / np.maximum(high - low, 1e-6), 0, 1))


def gray_world(image: Array, range_m: Array) -> Array:
    """One gain a channel that makes the mean over pixels with a known range gray (Buchsbaum
    1980).
    """
    known = np.isfinite(range_m)
    mean = image[known].mean(axis=0)
    return expose(image * (mean.mean() / np.maximum(mean, 1e-6)), known)


def simple_model(image: Array, range_m: Array) -> Array:
    """One coefficient a channel for both attenuation and backscatter (paper, eqs. 2 and 3), then
    gray world.

    Backscatter is fitted to the darkest hundredth of ten range bins by least squares; J = (I - B)
    exp(a z).
    """
    known = np.isfinite(range_m)
    z, dark = darkest(image[known], range_m[known])
    result = np.full(image.shape, np.nan)
    for c in range(3):
        rate, (level,) = _best_rates(
            z, dark[:, c], 1, lambda z, rates: 1 - np.exp(-rates[0] * z)[:, None]
        )
        a = rate[0]
        result[known, c] = np.maximum(
            image[known, c] - level * -np.expm1(-a * range_m[known]), 0
        ) * np.exp(a * range_m[known])
    return gray_world(result, range_m)


def sea_thru(image: Array, range_m: Array) -> Array:
    """Akkaynak and Treibitz, CVPR 2019: backscatter with residual from the darkest, illuminant by
    local space average color, attenuation of two exponentials so that it gives back the ranges,
    then gray world.
    """
    known = np.isfinite(range_m)
    z, dark = darkest(image[known], range_m[known])
    direct = np.full(image.shape, np.nan)
    for c in range(3):
        (beta, alpha), (level, rest) = _best_rates(
            z,
            dark[:, c],
            2,
            lambda z, rates: np.stack([1 - np.exp(-rates[0] * z), np.exp(-rates[1] * z)], axis=1),
        )
        backscatter = level * -np.expm1(-beta * range_m[known]) + rest * np.exp(
            -alpha * range_m[known]
        )
        direct[known, c] = np.maximum(image[known, c] - backscatter, 0)
    coarse = local_space_average(direct, range_m)
    result = np.full(image.shape, np.nan)
    for c in range(3):
        seen = known & (coarse[..., c] > 1e-3)
        attenuation = _two_exponentials(
            range_m[seen], -np.log(np.minimum(coarse[seen, c], 1)) / range_m[seen]
        )
        result[known, c] = direct[known, c] * np.exp(attenuation(range_m[known]) * range_m[known])
    return gray_world(result, range_m)


PAPER, OURS = "paper", "stereo-seecolor"
"""Names of the paper's method and of this program's beside the others."""

METHODS: dict[str, Method] = {
    "raw": raw,
    "contrast stretch": contrast_stretch,
    "gray world": gray_world,
    "simple model": simple_model,
    "sea-thru": sea_thru,
}


def expose(image: Array, known: NDArray[np.bool_], fraction: float = CLIPPED_FRACTION) -> Array:
    """The image scaled so that a fraction of its known pixels has a channel at full scale."""
    brightest = float(np.quantile(image[known].max(axis=-1), 1 - fraction))
    return image / brightest if brightest > 0 else image


def darkest(pixels: Array, range_m: Array) -> tuple[Array, Array]:
    """Pixels for Sea-thru's estimate of backscatter: ranges (K,), colors (K, 3) of the darkest
    hundredth of ten range bins.
    """
    edges = np.linspace(range_m.min(), range_m.max(), DARK_BINS + 1)
    bins = np.clip(np.digitize(range_m, edges) - 1, 0, DARK_BINS - 1)
    ranges, colors = [], []
    for b in range(DARK_BINS):
        inside = np.flatnonzero(bins == b)
        number = int(np.ceil(DARK_FRACTION * inside.size))
        if number:
            dark = inside[np.argpartition(pixels[inside].sum(axis=1), number - 1)[:number]]
            ranges.append(range_m[dark])
            colors.append(pixels[dark])
    return np.concatenate(ranges), np.concatenate(colors)


def local_space_average(direct: Array, range_m: Array) -> Array:
    """Ebner's local space average color over neighbors of about the same range, doubled: the
    illuminant (Sea-thru, eqs. 14-15).

    On a grid of at most 160 columns, whose cells average with the neighbors within a tenth of the
    range's spread.
    """
    height, width = range_m.shape
    scale = min(1.0, _GRID_WIDTH / width)
    size = (max(int(width * scale), 1), max(int(height * scale), 1))
    z: Array = cv2.resize(range_m, size, interpolation=cv2.INTER_NEAREST)
    small: Array = cv2.resize(direct, size, interpolation=cv2.INTER_NEAREST)
    near = 0.1 * (np.nanmax(range_m) - np.nanmin(range_m)) + 1e-6
    known = np.isfinite(z)
    small = np.where(known[..., None], small, 0.0)
    average, weight = small.copy(), 0.02
    padded_z = np.pad(z, 1, constant_values=np.nan)
    with np.errstate(invalid="ignore"):
        joined = [np.abs(_shifted(padded_z, dy, dx) - z) < near for dy, dx in _NEIGHBORS]
    number = np.maximum(sum(mask.astype(np.float64) for mask in joined), 1)[..., None]
    for _ in range(_AVERAGING_STEPS):
        padded = np.pad(average, ((1, 1), (1, 1), (0, 0)))
        around = sum(
            _shifted(padded, dy, dx) * mask[..., None]
            for (dy, dx), mask in zip(_NEIGHBORS, joined, strict=True)
        )
        average = (1 - weight) * np.asarray(around) / number + weight * small
    grown: Array = cv2.resize(2.0 * average, (width, height), interpolation=cv2.INTER_LINEAR)
    return grown


_NEIGHBORS = ((-1, 0), (1, 0), (0, -1), (0, 1))


def _shifted(padded: Array, dy: int, dx: int) -> Array:
    return padded[1 + dy : padded.shape[0] - 1 + dy, 1 + dx : padded.shape[1] - 1 + dx]


def _best_rates(
    z: Array, values: Array, number: int, basis: Callable[[Array, Array], Array]
) -> tuple[Array, Array]:
    """Fit ``values`` by least squares on a basis that depends on rates, which are searched on a
    grid of 0 to 5 per meter.

    Returns the rates (number,) and the weights of the basis, which are kept in [0, 1], as in the
    paper.
    """
    grid = np.concatenate([np.linspace(0.02, 1, 25), np.linspace(1.1, 5, 12)])
    best: tuple[float, Array, Array] | None = None
    for rates in np.stack(np.meshgrid(*[grid] * number, indexing="ij"), axis=-1).reshape(
        -1, number
    ):
        columns = basis(z, rates)
        normal = columns.T @ columns + 1e-9 * np.eye(columns.shape[1])
        weights = np.clip(np.linalg.solve(normal, columns.T @ values), 0, 1)
        error = float(((columns @ weights - values) ** 2).sum())
        if best is None or error < best[0]:
            best = (error, rates, weights)
    assert best is not None
    return best[1], best[2]


def _two_exponentials(z: Array, attenuation: Array) -> Callable[[Array], Array]:
    """a(z) = w exp(-v z) + y exp(-x z) of coarse attenuation, by least squares on what the ranges
    then are (Sea-thru, eq. 17).
    """
    step = max(1, z.size // 4000)
    z, attenuation = z[::step], np.maximum(attenuation[::step], LEAST_ATTENUATION)
    optical = attenuation * z
    grid = np.array([0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2])
    best: tuple[float, Array, Array] | None = None
    for i, v in enumerate(grid):
        for x in grid[i + 1 :]:
            columns = np.stack([z * np.exp(-v * z), z * np.exp(-x * z)], axis=1)
            weights = np.linalg.solve(columns.T @ columns + 1e-9 * np.eye(2), columns.T @ optical)
            if (weights < 0).any():  # both terms fall: the better one alone
                alone = np.maximum(columns.T @ optical, 0) / (columns**2).sum(axis=0)
                errors = ((columns * alone - optical[:, None]) ** 2).sum(axis=0)
                weights = np.where(np.arange(2) == errors.argmin(), alone, 0)
            fitted = np.maximum(columns @ weights / z, LEAST_ATTENUATION)
            error = float((((optical / fitted) - z) ** 2).mean())
            if best is None or error < best[0]:
                best = (error, np.array([v, x]), weights)
    assert best is not None
    rates, weights = best[1], best[2]
    return lambda z: np.asarray(np.exp(-rates * z[:, None]) @ weights)


# Corrected images of other tools, read from folders, to be scored beside this program's.


@dataclass(frozen=True, eq=False)
class OtherResults:
    """Corrected images of other tools. folders: name of a method -> stem of an image -> its
    corrected image.
    """

    folders: dict[str, dict[str, Path]]

    @classmethod
    def of(cls, folders: Sequence[str | Path]) -> "OtherResults":
        """The images in these folders; a method has the name of its folder, or the one before it:
        ``name=folder``.

        Raises InputError where two methods have the same name, or a folder holds no image, or two
        of the same name.
        """
        found: dict[str, dict[str, Path]] = {}
        for given in folders:
            named, _, place = str(given).rpartition("=")
            folder = Path(given) if not named or Path(given).exists() else Path(place)
            name = named if folder != Path(given) else folder.resolve().name
            if name in (*METHODS, PAPER, OURS):
                raise InputError(
                    f"{folder}: a method of the table already has the name {name!r}: give "
                    "another name, name=folder"
                )
            if name in found:
                raise InputError(
                    f"{folder}: another folder of results has the name {name!r}, too: give "
                    "another name, name=folder"
                )
            found[name] = _by_stem(list_images(folder, "corrected images").files)
        return cls(found)

    def missing(self, stems: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """Method -> the stems of these images that it lacks, for methods that lack any."""
        lacking = {
            method: tuple(stem for stem in stems if stem not in files)
            for method, files in self.folders.items()
        }
        return {method: names for method, names in lacking.items() if names}

    def refuse_other_names(self, stems: Sequence[str]) -> None:
        """Raise InputError where a method has none of these images: its files have other names."""
        for method, files in self.folders.items():
            if files.keys().isdisjoint(stems):
                raise InputError(
                    f"{method}: none of its images has the name of an image to score: its first "
                    f"is {min(files)!r}, the first to score is {min(stems)!r}: name its "
                    "images like their source images"
                )

    def corrected(self, stem: str, shape: tuple[int, ...]) -> dict[str, NDArray[np.float64]]:
        """Method -> (H, W, 3) in [0, 1] as displayed, of the methods that have this image; NaN
        where it is black, as unknown.

        Raises InputError where an image is not of the size (H, W) of the one that it was made from.
        """
        results = {}
        for method, files in self.folders.items():
            if stem not in files:
                continue
            image = _of_size(files[stem], shape)
            shown = image / float(np.iinfo(image.dtype).max)
            results[method] = np.where((image == 0).all(axis=2, keepdims=True), np.nan, shown)
        return results

    def images(self, stem: str, shape: tuple[int, ...]) -> dict[str, Image]:
        """Method -> its image of that stem, unchanged; all methods must have it. Raises InputError
        where one has another size.
        """
        return {method: _of_size(files[stem], shape) for method, files in self.folders.items()}


def _by_stem(files: Iterable[Path]) -> dict[str, Path]:
    found: dict[str, Path] = {}
    for path in files:
        if path.stem in found:
            raise InputError(
                f"{path}: {found[path.stem].name} has the same name: leave only one of them in "
                "the folder"
            )
        found[path.stem] = path
    return found


def _of_size(path: Path, shape: tuple[int, ...]) -> Image:
    image = read_image(path)
    if image.shape[:2] != shape[:2]:
        size, expected = (f"{sides[1]}x{sides[0]}" for sides in (image.shape, shape))
        raise InputError(f"{path}: is {size} px, but its source image is {expected}: resize it")
    return image
