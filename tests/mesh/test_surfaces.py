"""Dent surfaces and pipe shells: closed, in true size and one frame, read back alike by two libraries."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from deform.errors import OptionError
from deform.mesh import write_dent_surfaces, write_zone_shells
from deform.mesh.colours import colours
from deform.mesh.compare import distance
from deform.mesh.dent_surface import dent_surface, depth_grid
from deform.mesh.preview import preview
from deform.options import MeshOptions
from deform.run import store
from tests.report.fabricate import OD, WALL, write_folder

trimesh = pytest.importorskip("trimesh")
o3d = pytest.importorskip("open3d")
RADIUS = OD / 2 - WALL


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("mesh"), length_m=4000.0, step_m=1.0)


def _window(depth: float, clock_deg: float = 0.0, noise: float = 0.0) -> xr.Dataset:
    s, clock = np.arange(-0.6, 0.6, 0.02), np.arange(0, 360, 10.0)
    around = (clock - clock_deg + 180) % 360 - 180
    bowl = depth * np.exp(-((s[:, None] / 0.1) ** 2) - (around[None, :] / 20) ** 2)
    radius = RADIUS - bowl + np.random.default_rng(0).normal(0, noise, bowl.shape)
    reference = ("scan", np.full(s.size, RADIUS))
    return xr.Dataset(
        {"radius": (("scan", "clock"), radius), "chainage": ("scan", s + 50), "reference_radius": reference}, {"clock": clock}
    )


def _surface(window: xr.Dataset, **options: object):
    return dent_surface(window, 50.0, 0.5, wall_thickness=WALL, options=MeshOptions(**options))  # type: ignore[arg-type]  # test values


def test_round_pipe_gives_a_closed_tube_with_the_volume_of_its_steel() -> None:
    surface = _surface(_window(0.0))
    mesh = trimesh.Trimesh(surface.vertices, surface.triangles, process=False)
    n = 72
    ring = n / 2 * np.sin(2 * np.pi / n) * ((RADIUS + WALL) ** 2 - RADIUS**2)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(ring * np.ptp(surface.vertices[:, 0]), rel=1e-9)


@pytest.mark.parametrize("clock_deg", [0.0, 90.0, 200.0])
def test_the_dent_lies_at_its_clock_and_has_its_depth(clock_deg: float) -> None:
    surface = _surface(_window(0.01, clock_deg))
    deepest = surface.vertices[int(np.argmax(surface.value))]
    assert surface.value.max() == pytest.approx(0.01, abs=1e-4)
    assert abs(deepest[0]) < 0.02
    assert np.degrees(np.arctan2(deepest[1], deepest[2])) % 360 == pytest.approx(clock_deg, abs=5.1)
    assert np.hypot(*deepest[1:]) == pytest.approx(RADIUS - 0.01, abs=2e-4)


def test_exaggeration_moves_the_wall_and_is_written_down() -> None:
    surface = _surface(_window(0.01), exaggeration=5.0)
    inner = np.hypot(surface.vertices[:, 1], surface.vertices[:, 2])
    assert inner.min() == pytest.approx(RADIUS - 0.05, abs=1e-3)
    assert surface.meaning["depth_exaggeration"] == 5.0


def test_the_distance_between_two_years_is_the_growth() -> None:
    before, after = _surface(_window(0.008)), _surface(_window(0.011))
    assert distance(before, before)[before.value.argmax()] == pytest.approx(0.0, abs=1e-6)
    grown = distance(after, before)
    apex = int(np.argmax(after.value[: after.value.size // 2]))
    assert abs(grown[apex]) == pytest.approx(0.003, abs=3e-4)


def test_scans_and_arms_that_gave_nothing_are_bridged() -> None:
    window = _window(0.01)
    window["radius"][5] = np.nan
    window["radius"][:, 7] = np.nan
    depth = depth_grid(window, 50.0, 0.5, MeshOptions())
    assert np.isfinite(depth.values).all()
    assert depth.values.max() == pytest.approx(0.01, abs=3e-4)


def test_every_measured_dent_has_its_files_and_two_libraries_agree_on_them(folder: Path) -> None:
    written = write_dent_surfaces(folder, ("ply", "glb", "stl", "obj", "png"))
    assert len(written) == 10 * 6  # ten measured dents: five formats and a sidecar
    for end in ("ply", "glb", "stl", "obj"):
        path = folder / "dents" / f"D02_demo-2023.{end}"
        mesh = trimesh.load(path, force="mesh")
        other = o3d.io.read_triangle_mesh(str(path))
        assert mesh.is_watertight
        assert len(other.vertices) > 500
        np.testing.assert_allclose(mesh.bounds, [other.get_min_bound(), other.get_max_bound()], atol=1e-6)
    said = json.loads((folder / "dents" / "D02_demo-2023.json").read_text())
    assert said["unit"] == "m"
    assert said["date"] == "2023-07-02"
    assert "downstream" in said["frame"]
    assert said["vertices"] > 500


def test_all_years_of_a_dent_stand_in_one_frame(folder: Path) -> None:
    write_dent_surfaces(folder, ("ply",))
    boxes = [trimesh.load(folder / "dents" / f"D01_demo-{year}.ply").bounds for year in (2019, 2021, 2023)]
    np.testing.assert_allclose(boxes[0], boxes[2], atol=0.021)


def test_colour_by_change_is_white_where_nothing_changed_and_red_where_it_grew(folder: Path) -> None:
    write_dent_surfaces(folder, ("ply",), MeshOptions(colour="change"))
    said = json.loads((folder / "dents" / "D02_demo-2023.json").read_text())
    assert said["colour"]["high"] == pytest.approx(0.0068, abs=0.001)
    paint = colours(np.array([0.0, 0.0068, -0.0068]), diverging=True)
    assert paint[0].min() > 0.95
    assert paint[1][0] > paint[1][2]


def test_the_preview_shows_the_dent_in_its_middle() -> None:
    depth = depth_grid(_window(0.01, 90.0), 50.0, 0.5, MeshOptions())
    depth.attrs["clock_deg"] = 90.0
    picture = preview(depth, 200).astype(float).sum(axis=2)
    rows, width = picture.shape
    middle = picture[rows // 2 - 10 : rows // 2 + 10, width // 2 - 10 : width // 2 + 10].mean()
    assert middle < 0.6 * picture[:10, :10].mean()


def test_zone_shells_are_closed_and_move_by_the_exaggerated_displacement(folder: Path) -> None:
    write_zone_shells(folder, ("ply",), MeshOptions(shell_exaggeration=10.0))
    still, moved = (trimesh.load(folder / "zones" / f"Z1_demo-{year}.ply") for year in (2019, 2023))
    assert still.is_watertight
    shift = np.linalg.norm(moved.vertices - still.vertices, axis=1).max()
    inside = store.read_dataset(folder / "comparison.nc").sel(epoch="demo-2023", chainage=slice(2640, 2800))
    size = np.sqrt(sum(inside[f"displacement_{c}"] ** 2 for c in ("east", "north", "up"))).max()
    assert shift == pytest.approx(10 * float(size), rel=0.02)


def test_an_unknown_format_is_refused(folder: Path) -> None:
    with pytest.raises(OptionError, match="dwg"):
        write_dent_surfaces(folder, ("dwg",))


def test_a_folder_without_dents_writes_nothing(tmp_path: Path) -> None:
    assert write_dent_surfaces(write_folder(tmp_path, length_m=300.0, step_m=1.0, dents=False, zones=False)) == []
