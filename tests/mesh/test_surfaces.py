"""Dent surfaces and pipe shells: closed, in true size and one frame, read back alike by two libraries."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from deform.errors import OptionError
from deform.mesh import write_dent_surfaces, write_zone_shells
from deform.mesh.colours import colours
from deform.mesh.compare import inner_wall_movement
from deform.mesh.dent_surface import dent_surface, depth_grid
from deform.mesh.pipe_shell import zone_shell
from deform.mesh.preview import preview
from deform.mesh.strain_field import strain_grid
from deform.mesh.surface import Surface
from deform.options import MeshOptions
from deform.run import build, store
from deform.strain.dent import add_dent_strain
from tests.report.fabricate import OD, WALL, write_folder

trimesh = pytest.importorskip("trimesh")
o3d = pytest.importorskip("open3d")
RADIUS = OD / 2 - WALL
VALIDATE = """
const validator = require("gltf-validator"), files = require("fs");
(async () => {
  for (const path of process.argv.slice(1)) {
    const { issues } = await validator.validateBytes(new Uint8Array(files.readFileSync(path)));
    console.log(issues.numErrors, issues.numWarnings);
  }
})();
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("mesh"), length_m=4000.0, step_m=1.0)


@pytest.fixture(scope="module")
def written(folder: Path) -> list[Path]:
    """Every dent and zone in every format."""
    return [*write_dent_surfaces(folder, ("ply", "glb", "stl", "obj", "png")), *write_zone_shells(folder, ("ply", "glb"))]


@pytest.fixture
def one_dent(folder: Path, tmp_path: Path) -> Path:
    """The same folder with one dent in its table."""
    (tmp_path / "runs").symlink_to(folder / "runs")
    table = store.read_table(folder / "tables" / "dents.csv", "dents")
    store.write_table(table[table.dent_id == "D02"], tmp_path / "tables" / "dents.csv", "dents")
    return tmp_path


def _window(depth: float, clock_deg: float = 0.0, noise: float = 0.0, step_deg: float = 10.0) -> xr.Dataset:
    s, clock = np.arange(-0.6, 0.6, 0.02), np.arange(0, 360, step_deg)
    around = (clock - clock_deg + 180) % 360 - 180
    bowl = depth * np.exp(-((s[:, None] / 0.1) ** 2) - (around[None, :] / 20) ** 2)
    radius = RADIUS - bowl + np.random.default_rng(0).normal(0, noise, bowl.shape)
    reference = ("scan", np.full(s.size, RADIUS))
    return xr.Dataset(
        {"radius": (("scan", "clock"), radius), "chainage": ("scan", s + 50), "reference_radius": reference}, {"clock": clock}
    )


def _surface(window: xr.Dataset, **options: object) -> Surface:
    chosen = MeshOptions(**options)  # type: ignore[arg-type]  # test values
    return dent_surface(depth_grid(window, 50.0, 0.5, chosen), wall_thickness=WALL, options=chosen)


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
    assert inner_wall_movement(before, before) == pytest.approx(
        {"most_inward_m": 0.0, "most_outward_m": 0.0, "rms_m": 0.0}, abs=1e-6
    )
    assert inner_wall_movement(after, before)["most_inward_m"] == pytest.approx(0.003, abs=3e-4)
    assert inner_wall_movement(before, after)["most_outward_m"] == pytest.approx(0.003, abs=3e-4)


def test_scans_and_arms_that_gave_nothing_are_bridged() -> None:
    window = _window(0.01)
    window["radius"][5] = np.nan
    window["radius"][:, 7] = np.nan
    depth = depth_grid(window, 50.0, 0.5, MeshOptions())
    assert np.isfinite(depth.values).all()
    assert depth.values.max() == pytest.approx(0.01, abs=3e-4)


def test_distances_are_taken_between_inner_walls_and_only_where_both_are() -> None:
    before, after = _window(0.008), _window(0.008)
    after["radius"] += 0.002  # the whole wall stands further out, by less than half the steel and by more
    long = depth_grid(after, 50.0, 0.5, MeshOptions())
    short = depth_grid(before, 50.0, 0.3, MeshOptions())
    surfaces = [dent_surface(depth, wall_thickness=WALL, options=MeshOptions()) for depth in (long, short)]
    moved = inner_wall_movement(*surfaces)
    assert moved["most_outward_m"] == pytest.approx(0.002, abs=1e-4)
    assert moved["most_inward_m"] < 1e-4
    assert moved["rms_m"] == pytest.approx(0.002, abs=1e-4)


def test_the_strain_on_a_surface_is_that_of_its_dent_and_unknown_away_from_it() -> None:
    window = _window(0.01, 90.0, step_deg=5.0)
    sizes = {"clock_deg": 90.0, "depth_m": 0.01, "length_m": 0.3, "width_m": 0.16}
    depth = depth_grid(window, 50.0, 0.5, MeshOptions())
    strain = strain_grid(window, depth, wall_thickness=WALL, **sizes)
    assert strain is not None
    dents = xr.Dataset({name: ("dent", [sizes[f"{name}_m"]]) for name in ("depth", "length", "width")})
    dents = dents.assign(chainage=("dent", [50.0]), clock=("dent", [90.0]))
    told = add_dent_strain(dents, window, outside_diameter=OD, wall_thickness=WALL)
    assert told["strain_basis"].values[0] == "profile"
    assert float(strain.max()) == pytest.approx(float(told["strain_max"][0]), rel=0.03)  # the finer grid may miss the very cell
    assert np.isnan(strain.sel(clock=270.0, method="nearest")).all()
    assert np.isnan(strain.sel(distance=0.45, method="nearest")).all()
    assert strain_grid(window, depth, wall_thickness=WALL, **(sizes | {"width_m": np.nan})) is None


def test_the_strain_of_a_surface_takes_the_wall_of_its_joint(one_dent: Path) -> None:
    """A joint of twice the nominal wall: its sidecar says the strain that the run's dents say, not that of the nominal wall."""
    path = one_dent / "runs" / "demo-2023.nc"
    run = store.read_run(path)
    dents, wall = (run[name].to_dataset() for name in ("dents", "caliper"))
    dents = build.add(dents, "dents", {"wall_thickness": np.full(dents.sizes["dent"], 2 * WALL)})
    told, thin = (
        float(add_dent_strain(given, wall, outside_diameter=OD, wall_thickness=WALL)["strain_max"][1])
        for given in (dents, dents.drop_vars("wall_thickness"))
    )
    (one_dent / "runs").unlink()
    store.write_run(build.run_tree(run.attrs, dents=dents, caliper=wall), path)
    write_dent_surfaces(one_dent, ("ply",))
    said = json.loads((one_dent / "dents" / "D02_demo-2023.json").read_text())
    assert said["wall_thickness_m"] == pytest.approx(2 * WALL)
    assert said["strain_max"] == pytest.approx(told, rel=0.05)
    assert abs(told - thin) > 0.1 * told


def test_without_a_wall_thickness_no_surface_is_invented(one_dent: Path, caplog: pytest.LogCaptureFixture) -> None:
    run = store.read_run(one_dent / "runs" / "demo-2023.nc", groups=("dents", "caliper", "centreline"))
    attrs = {k: v for k, v in run.attrs.items() if k != "nominal_wall_m"}
    bare = build.run_tree(attrs, **{name: run[name].to_dataset() for name in run.children})
    (one_dent / "runs").unlink()
    store.write_run(bare, one_dent / "runs" / "demo-2023.nc")
    assert write_dent_surfaces(one_dent, ("ply",)) == []
    assert "wall thickness" in caplog.text
    comparison = xr.Dataset(attrs={"reference": "demo-2023"})
    assert zone_shell(bare, comparison, "demo-2023", 100.0, 200.0, MeshOptions()) is None


def test_every_measured_dent_has_its_files_and_two_libraries_agree_on_them(folder: Path, written: list[Path]) -> None:
    assert sum(path.parent.name == "dents" for path in written) == 10 * 6  # ten measured dents: five formats and a sidecar
    for end in ("ply", "glb", "stl", "obj"):
        path = folder / "dents" / f"D02_demo-2023.{end}"
        mesh = trimesh.load(path, force="mesh")
        other = o3d.io.read_triangle_mesh(str(path))
        assert mesh.is_watertight
        assert len(other.vertices) > 500
        np.testing.assert_allclose(mesh.bounds, [other.get_min_bound(), other.get_max_bound()], atol=1e-6)
    said = json.loads((folder / "dents" / "D02_demo-2023.json").read_text())
    assert (said["unit"], said["date"], said["colour"]["unit"]) == ("m", "2023-07-02", "m")
    assert "downstream" in said["frame"]
    assert said["vertices"] > 500
    assert said["moved_since"]["run"] == "demo-2019"
    assert said["moved_since"]["most_inward_m"] == pytest.approx(0.0146 - 0.0078, abs=8e-4)


def test_a_ply_carries_depth_radius_change_and_strain_of_every_vertex(folder: Path, written: list[Path]) -> None:
    head = (folder / "dents" / "D02_demo-2023.ply").read_bytes()[:800].decode("latin1")
    for name in ("depth_m", "radius_m", "change_m", "strain"):
        assert f"property float {name}" in head
    fields = trimesh.load(folder / "dents" / "D02_demo-2023.ply").metadata["_ply_raw"]["vertex"]["data"]
    assert float(fields["depth_m"].max()) == pytest.approx(0.0146, abs=6e-4)
    assert float(fields["change_m"].max()) == pytest.approx(0.0068, abs=8e-4)
    np.testing.assert_allclose(fields["depth_m"] + fields["radius_m"], RADIUS, atol=1e-6)


def test_a_glb_is_upright_matt_and_tells_its_unit_and_frame(folder: Path, written: list[Path]) -> None:
    content = (folder / "dents" / "D03_demo-2019.glb").read_bytes()
    assert content[:4] == b"glTF"
    size = int.from_bytes(content[12:16], "little")
    tree = json.loads(content[20 : 20 + size])
    node = next(n for n in tree["nodes"] if "mesh" in n)
    turn = np.array(node["matrix"]).reshape(4, 4).T[:3, :3]
    np.testing.assert_allclose(turn @ [0, 0, 1], [0, 1, 0])  # up is y in glTF
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert tree["materials"][0]["pbrMetallicRoughness"]["metallicFactor"] == 0.0
    assert tree["meshes"][0]["extras"]["unit"] == "m"
    assert all("target" in view for view in tree["bufferViews"])


def test_the_validator_of_gltf_finds_nothing(written: list[Path]) -> None:
    node = shutil.which("node")
    known = node and subprocess.run([node, "-e", "require('gltf-validator')"], capture_output=True, check=False).returncode == 0
    if not known:
        pytest.skip("node or its gltf-validator is not here (npm install --global gltf-validator, and NODE_PATH)")
    paths = [str(path) for path in written if path.suffix == ".glb"]
    assert len(paths) == 10 + 2 * 3
    said = subprocess.run([str(node), "-e", VALIDATE, *paths], capture_output=True, text=True, check=True).stdout.split("\n")
    assert said[:-1] == ["0 0"] * len(paths)


def test_all_years_of_a_dent_stand_in_one_frame_and_on_one_extent(folder: Path, written: list[Path]) -> None:
    boxes = [trimesh.load(folder / "dents" / f"D01_demo-{year}.ply").bounds for year in (2019, 2021, 2023)]
    np.testing.assert_allclose(boxes[0], boxes[2], atol=0.002)


def test_colour_by_change_is_white_where_nothing_changed_and_red_where_it_grew(one_dent: Path) -> None:
    write_dent_surfaces(one_dent, ("ply",), MeshOptions(colour="change"))
    said = json.loads((one_dent / "dents" / "D02_demo-2023.json").read_text())
    assert said["colour"]["high"] == pytest.approx(0.0068, abs=0.001)
    assert said["colour"]["low"] == -said["colour"]["high"]
    assert "colour_scale" not in said
    paint = colours(np.array([0.0, 0.0068, -0.0068]), "change")
    assert paint[0].min() > 0.95
    assert paint[1][0] > paint[1][2]
    first = json.loads((one_dent / "dents" / "D02_demo-2019.json").read_text())
    assert (first["colour"]["low"], first["colour"]["high"]) == (0.0, 0.0)  # the first run has not changed
    mesh = trimesh.load(one_dent / "dents" / "D02_demo-2019.ply")
    assert np.asarray(mesh.visual.vertex_colors)[:, :3].min() > 240  # and is white


@pytest.mark.parametrize("shows", ["depth", "change", "strain"])
def test_zero_is_white_where_nothing_stands_out(shows: str) -> None:
    assert colours(np.zeros(3), shows).min() > 0.95


def test_colour_by_strain_leaves_the_undented_wall_grey(one_dent: Path) -> None:
    write_dent_surfaces(one_dent, ("ply", "png"), MeshOptions(colour="strain"))
    said = json.loads((one_dent / "dents" / "D02_demo-2023.json").read_text())
    assert said["colour"]["unit"] == "1"
    assert 0.001 < said["colour"]["high"] < 0.2
    mesh = trimesh.load(one_dent / "dents" / "D02_demo-2023.ply")
    far = np.abs(mesh.vertices[:, 0]) > 0.3
    assert (np.asarray(mesh.visual.vertex_colors)[far, :3] == 178).all()


@pytest.mark.parametrize("colour", ["depth", "change", "strain"])
def test_the_preview_shows_the_dent_in_its_middle(colour: str) -> None:
    depth = depth_grid(_window(0.01, 90.0), 50.0, 0.5, MeshOptions())
    depth.attrs["clock_deg"] = 90.0
    picture = preview(depth, value=None if colour == "depth" else depth.values, shows=colour, width=200).astype(float)
    rows, width, _ = picture.shape
    middle = picture[rows // 2 - 10 : rows // 2 + 10, width // 2 - 10 : width // 2 + 10].mean(axis=(0, 1))
    assert middle.sum() < 0.6 * picture[:10, :10].mean(axis=(0, 1)).sum()
    assert (middle[0] > middle[2]) == (colour == "change")  # what grew is red although nothing shrank


def test_previews_of_one_dent_share_their_colours_so_that_growth_is_seen() -> None:
    depths = [depth_grid(_window(d), 50.0, 0.5, MeshOptions()) for d in (0.005, 0.010)]
    dark = [preview(depth, top=0.010, width=200)[..., 0].min() for depth in depths]
    assert dark[0] > dark[1] + 20


def test_zone_shells_are_closed_and_move_by_the_exaggerated_displacement(folder: Path, written: list[Path]) -> None:
    still, moved = (trimesh.load(folder / "zones" / f"Z1_demo-{year}.ply") for year in (2019, 2023))
    assert still.is_watertight
    shift = np.linalg.norm(moved.vertices - still.vertices, axis=1).max()
    inside = store.read_dataset(folder / "comparison.nc").sel(epoch="demo-2023", chainage=slice(2640, 2800))
    size = np.sqrt(sum(inside[f"displacement_{c}"] ** 2 for c in ("east", "north", "up"))).max()
    assert shift == pytest.approx(10 * float(size), rel=0.02)
    said = json.loads((folder / "zones" / "Z1_demo-2023.json").read_text())
    assert (said["zone"], said["unit"], said["displacement_exaggeration"]) == ("Z1", "m", 10.0)
    assert said["date"] == "2023-07-02"
    assert not list((folder / "zones").glob("Z3*"))  # replaced pipe has not moved


def test_pipe_whose_movement_is_unknown_is_grey_and_said(folder: Path) -> None:
    comparison = store.read_dataset(folder / "comparison.nc")
    comparison["displacement_up"].loc[{"chainage": slice(2700, 2720)}] = np.nan
    reference = store.read_run(folder / "runs" / "demo-2019.nc", groups=("centreline",))
    surface = zone_shell(reference, comparison, "demo-2023", 2660.0, 2779.0, MeshOptions())
    assert surface is not None
    assert surface.meaning["displacement_unknown_m"] == pytest.approx(20.0, abs=2.0)
    assert np.isnan(surface.value).any()
    assert np.isfinite(surface.vertices).all()


def test_an_unknown_format_is_refused(folder: Path) -> None:
    with pytest.raises(OptionError, match="dwg"):
        write_dent_surfaces(folder, ("dwg",))


def test_folders_without_dents_zones_or_comparison_write_nothing(tmp_path: Path) -> None:
    bare = write_folder(tmp_path / "bare", length_m=300.0, step_m=1.0, dents=False, zones=False)
    assert write_dent_surfaces(bare) == []
    assert write_zone_shells(bare) == []
    assert write_zone_shells(write_folder(tmp_path / "listed", length_m=300.0, listing=True)) == []
