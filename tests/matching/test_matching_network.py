"""A user's own stereo network in place of semi-global matching."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from matching_scenes import render

from calibration.formats import load_rig
from stereo_seecolor.config import MatchingConfig, RunConfig
from stereo_seecolor.errors import ConfigError, MatchingError
from stereo_seecolor.matching.matcher import Matcher
from stereo_seecolor.pipeline import Pipeline

SHIFTS = np.arange(16, 48)
SAMPLE = Path(__file__).resolve().parents[2] / "data_samples/reef"


def export(
    path: Path, inputs: tuple[str, str] = ("left", "right"), rows: int | None = None
) -> Path:
    """Block matching as a network: shift the right image, box-filter the difference, take the
    least.
    """
    helper, numpy_helper = onnx.helper, onnx.numpy_helper
    constants, nodes, costs = [], [], []

    def constant(name: str, value: np.ndarray) -> str:
        constants.append(numpy_helper.from_array(value, name))
        return name

    constant("zero", np.array(0, np.float32))
    constant("box", np.full((1, 3, 7, 7), 1 / 147, np.float32))
    for shift in SHIFTS:
        pads, last = (
            constant(f"pads{shift}", np.array([0, 0, 0, shift, 0, 0, 0, 0])),
            constant(f"end{shift}", np.array([-shift])),
        )
        constant(f"start{shift}", np.array([0]))
        constant(f"axis{shift}", np.array([3]))
        nodes += [
            helper.make_node(
                "Slice", [inputs[1], f"start{shift}", last, f"axis{shift}"], [f"cut{shift}"]
            ),
            helper.make_node("Pad", [f"cut{shift}", pads, "zero"], [f"moved{shift}"]),
            helper.make_node("Sub", [inputs[0], f"moved{shift}"], [f"signed{shift}"]),
            helper.make_node("Abs", [f"signed{shift}"], [f"difference{shift}"]),
            helper.make_node(
                "Conv", [f"difference{shift}", "box"], [f"cost{shift}"], pads=[3, 3, 3, 3]
            ),
        ]
        costs.append(f"cost{shift}")
    constant("first", np.array(SHIFTS[0], np.float32))
    nodes += [
        helper.make_node("Concat", costs, ["costs"], axis=1),
        helper.make_node("ArgMin", ["costs"], ["index"], axis=1, keepdims=1),
        helper.make_node("Cast", ["index"], ["whole"], to=onnx.TensorProto.FLOAT),
        helper.make_node("Add", ["whole", "first"], ["disparity"]),
    ]
    tensors = [
        helper.make_tensor_value_info(n, onnx.TensorProto.FLOAT, [1, 3, rows or "H", "W"])
        for n in inputs
    ]
    output = helper.make_tensor_value_info(
        "disparity", onnx.TensorProto.FLOAT, [1, 1, rows or "H", "W"]
    )
    graph = helper.make_graph(nodes, "block_matching", tensors, [output], constants)
    onnx.save(
        helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9),
        str(path),
    )
    return path


def config(model: Path) -> MatchingConfig:
    return MatchingConfig(engine=model, min_range_m=0.8)


@pytest.mark.slow
def test_a_network_gives_the_ranges(tmp_path: Path) -> None:
    scene = render((320, 256), relief_m=0.2, seed=3, focal_px=450.0)
    found = Matcher(scene.pair, config(export(tmp_path / "net.onnx"))).match(scene.frame)
    known = np.isfinite(found.disparity)
    assert known[scene.both].mean() > 0.7
    assert (np.abs(found.disparity - scene.disparity)[known] <= 1).mean() > 0.95
    assert found.confidence[known].min() > 0 and not found.confidence[~known].any()


@pytest.mark.slow
def test_ranges_of_another_network_at_the_same_path_are_not_taken(tmp_path: Path) -> None:
    rig, settings = load_rig(SAMPLE / "cam.yaml"), set[str]()
    for rows in (None, 480):
        network = config(export(tmp_path / "net.onnx", rows=rows))
        settings.add(Pipeline(rig, RunConfig(matching=network)).settings)
    assert len(settings) == 2


@pytest.mark.slow
def test_a_file_that_is_no_model_is_refused(tmp_path: Path) -> None:
    (tmp_path / "net.onnx").write_bytes(b"nonsense")
    with pytest.raises(ConfigError, match=r"net\.onnx cannot be loaded"):
        Matcher(render((64, 48)).pair, config(tmp_path / "net.onnx"))


@pytest.mark.slow
def test_other_inputs_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"must take 'left' and 'right'"):
        Matcher(render((64, 48)).pair, config(export(tmp_path / "net.onnx", ("a", "b"))))


@pytest.mark.slow
def test_a_network_for_another_size_fails_on_the_pair(tmp_path: Path) -> None:
    scene = render((320, 256), seed=3)
    with pytest.raises(MatchingError, match="failed on this pair"):
        Matcher(scene.pair, config(export(tmp_path / "net.onnx", rows=200))).match(scene.frame)
