"""The settings of mapping."""

from typing import Annotated, Any, Literal, Self

from pydantic import (
    Field,
    Strict,
    ValidationError,
    ValidatorFunctionWrapHandler,
    field_validator,
    model_validator,
)

from stereo_seecolor.config.stage import FilePath, StageConfig

Triple = Annotated[tuple[float, float, float], Strict(False)]
"""Three numbers, also given as a list."""


class MountConfig(StageConfig):
    """How the left camera sits on the vehicle, for navigation that gives the vehicle's pose and not
    the camera's.

    Vehicle axes: x forward, y starboard, z down. The camera (x right, y down, z along the optical
    axis) is turned by Rz(yaw) Ry(pitch) Rx(roll): all zero looks down with the image's right
    towards the bow.
    """

    xyz_m: Triple = Field(
        default=(0.0, 0.0, 0.0),
        description="Camera forward of the vehicle's reference point, to starboard of it and below "
        "it, meters.",
    )
    rpy_deg: Triple = Field(
        default=(0.0, 0.0, 90.0),
        description="Roll, pitch and yaw: turns about x, y and z, degrees; a yaw of 90: the top of "
        "the image is the bow.",
    )

    @field_validator("xyz_m", "rpy_deg", mode="wrap")
    @classmethod
    def _one_line(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            return handler(value)
        except ValidationError as error:
            raise ValueError("must be three numbers, such as [0, 0, 90]") from error


class MarkersConfig(StageConfig):
    """Square markers of known size, distance or position on the bottom; they constrain the map's
    scale, shape and place (docs/markers.md).
    """

    edge_m: float | None = Field(
        default=None, gt=0, description="Edge of the black border of all markers, meters."
    )
    family: Literal[
        "36h11", "25h9", "16h5", "aruco-4x4", "aruco-5x5", "aruco-6x6", "aruco-original"
    ] = Field(default="36h11", description="Family of the markers: of AprilTag, or ArUco.")
    bars: FilePath | None = Field(
        default=None,
        description="Scale bars, a CSV with first, second, length_m: middles of two markers.",
    )
    points: FilePath | None = Field(
        default=None,
        description="Surveyed places of markers, a CSV with marker, x_m, y_m, z_m and, if known, "
        "std_m (1 cm).",
    )

    @property
    def known(self) -> bool:
        """Whether anything is known of them."""
        return bool(self.edge_m or self.bars or self.points)


class MappingConfig(StageConfig):
    """Odometry, fusion and the map products."""

    engine: str = Field(
        default="tiles",
        description="What fuses the frames. tiles: weighs each measurement by its standard error. "
        "open3d: Open3D's VoxelBlockGrid, equal weights (needs the open3d extra). Or one that "
        "another package adds (docs/extending.md).",
    )
    voxel_m: float | None = Field(
        default=0.01,
        gt=0,
        allow_inf_nan=False,
        description="Edge of a fusion voxel, meters. auto: five pixels of the images at their "
        "median range.",
    )
    tile_m: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Edge of a tile of the map, meters; memory grows with its square. auto: 600 "
        "voxels.",
    )
    crs: Literal["auto", "utm", "local"] = Field(
        default="auto",
        description="Coordinates of all products. auto: meters around the survey's origin on "
        "Earth, if the poses give it, by transverse Mercator at scale 1. utm: of its UTM zone "
        "(needs the geo extra). local: meters without a place on Earth.",
    )
    fixes: FilePath | None = Field(
        default=None,
        description="Positions on Earth beside --poses, such as a buoy's: they place a track "
        "that has none (docs/mapping.md).",
    )
    mount: MountConfig = MountConfig()
    markers: MarkersConfig = MarkersConfig()
    poses: Literal["given", "prior"] = Field(
        default="prior",
        description="How a trajectory is used. prior: frames are placed by its poses and by the "
        "pictures, each weighted by its errors (needs the slam extra, GTSAM; without it as given). "
        "given: its poses are used unchanged, for exact poses.",
    )
    poses_of: Literal["format", "raw", "rectified"] = Field(
        default="format",
        description="A trajectory's poses are the left camera's as calibrated (raw), or the "
        "rectified one's; format: its own way.",
    )
    prior_position_std_m: float | None = Field(
        default=None,
        gt=0,
        description="Standard error of a trajectory's positions, east and north, or of fixes, as "
        "its sensor is known for. Not set: estimated from the dive.",
    )
    mosaic_m: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Pixel of the orthomosaic, meters. auto: a pixel of the images on the "
        "bottom; half a voxel on large areas.",
    )
    dem_m: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Pixel of the terrain model, meters. auto: a voxel.",
    )
    metrics_m: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Edge of a square of the structural metrics, meters. auto: 100 pixels of the "
        "terrain model.",
    )

    @property
    def voxel_edge_m(self) -> float:
        """voxel_m; auto, before the images are known, as the default."""
        return self.voxel_m or 0.01

    @property
    def tile_edge_m(self) -> float:
        """tile_m, or what follows from the voxels: 6 m at 1 cm."""
        return self.tile_m or 600 * self.voxel_edge_m

    @property
    def terrain_cell_m(self) -> float:
        """dem_m, or what follows from the voxels: finer cells only interpolate between them."""
        return self.dem_m or self.voxel_edge_m

    @property
    def mosaic_cell_m(self) -> float:
        """mosaic_m, or what suits a large area; the map of a small one is as fine as its images."""
        return self.mosaic_m or self.voxel_edge_m / 2

    @property
    def square_m(self) -> float:
        """metrics_m, or what follows from the terrain's cells: 1 m at 1 cm."""
        return self.metrics_m or 100 * self.terrain_cell_m

    @model_validator(mode="before")
    @classmethod
    def _auto_is_not_set(cls, values: Any) -> Any:
        sizes = ("voxel_m", "tile_m", "mosaic_m", "dem_m", "metrics_m")
        if not isinstance(values, dict):
            return values
        return {
            key: None if key in sizes and value == "auto" else value
            for key, value in values.items()
        }

    @model_validator(mode="after")
    def _tile_holds_blocks(self) -> Self:
        if self.tile_m and self.voxel_m and self.tile_m < 16 * self.voxel_m:
            raise ValueError(
                f"tile_m={self.tile_m:g} is less than 16 voxels: set it to at least "
                f"{16 * self.voxel_m:g}, or leave it out"
            )
        return self
