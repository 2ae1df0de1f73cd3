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
    """Pose of the left camera on the vehicle, for navigation that gives the pose of the vehicle and
    not of the camera.

    Vehicle axes: x forward, y starboard, z down. The camera (x right, y down, z along the optical
    axis) is rotated by Rz(yaw) Ry(pitch) Rx(roll): with all angles zero it looks down, and the
    right side of the image points to the bow.
    """

    xyz_m: Triple = Field(
        default=(0.0, 0.0, 0.0),
        description="Position of the camera relative to the vehicle's reference point: forward, "
        "starboard, down, meters.",
    )
    rpy_deg: Triple = Field(
        default=(0.0, 0.0, 90.0),
        description="Roll, pitch and yaw: rotations about x, y and z, degrees; with a yaw of "
        "90 the top of the image points to the bow.",
    )

    @field_validator("xyz_m", "rpy_deg", mode="wrap")
    @classmethod
    def _one_line(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            return handler(value)
        except ValidationError as error:
            raise ValueError("must be three numbers, such as [0, 0, 90]") from error


class MarkersConfig(StageConfig):
    """Square markers of known size, distance or position on the bottom; they constrain scale, shape
    and position of the map (docs/markers.md).
    """

    edge_m: float | None = Field(
        default=None, gt=0, description="Edge of the black border of all markers, meters."
    )
    family: Literal[
        "36h11", "25h9", "16h5", "aruco-4x4", "aruco-5x5", "aruco-6x6", "aruco-original"
    ] = Field(default="36h11", description="Family of the markers, AprilTag or ArUco.")
    bars: FilePath | None = Field(
        default=None,
        description=(
            "Scale bars: a CSV with first, second, length_m, the distance between the "
            "centers of two markers."
        ),
    )
    points: FilePath | None = Field(
        default=None,
        description="Surveyed positions of markers: a CSV with marker, x_m, y_m, z_m and, if "
        "known, std_m (default 1 cm).",
    )

    @property
    def known(self) -> bool:
        """Whether a size, a scale bar or a position is given."""
        return bool(self.edge_m or self.bars or self.points)


class MappingConfig(StageConfig):
    """Odometry, fusion and the map products."""

    engine: str = Field(
        default="tiles",
        description="Fusion engine. tiles: weighs each measurement by its standard error. open3d: "
        "Open3D's VoxelBlockGrid, equal weights (needs the open3d extra). Or one that "
        "another package adds (docs/extending.md).",
    )
    voxel_m: float | None = Field(
        default=0.01,
        gt=0,
        allow_inf_nan=False,
        description="Edge of a fusion voxel, meters. auto: five image pixels at the median range.",
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
        description="Coordinate system of all products. auto: transverse Mercator at scale 1 "
        "around the origin of the survey, meters, if the poses are georeferenced. utm: the "
        "UTM zone (needs the geo extra). local: meters without a position on Earth.",
    )
    fixes: FilePath | None = Field(
        default=None,
        description="Positions on Earth in addition to --poses, for example of a buoy: they "
        "georeference a local track (docs/mapping.md).",
    )
    mount: MountConfig = MountConfig()
    markers: MarkersConfig = MarkersConfig()
    poses: Literal["given", "prior"] = Field(
        default="prior",
        description="How a trajectory is used. prior: poses and images together determine "
        "the track, each weighted by its errors (needs the slam extra, GTSAM; without it as "
        "given). given: the poses are used unchanged; for exact poses.",
    )
    poses_of: Literal["format", "raw", "rectified"] = Field(
        default="format",
        description="Camera of the trajectory's poses: the left camera as calibrated (raw), or the "
        "rectified left camera; format: the camera that the format defines.",
    )
    prior_position_std_m: float | None = Field(
        default=None,
        gt=0,
        description="Standard error of the positions of a trajectory, east and north, or of fixes, "
        "from the specification of the sensor. Not set: estimated from the dive.",
    )
    mosaic_m: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Pixel size of the orthomosaic, meters. auto: an image pixel on the "
        "bottom; half a voxel for large areas.",
    )
    dem_m: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Pixel size of the terrain model, meters. auto: one voxel.",
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
