"""Built-in and folder objects."""

from pathlib import Path

import numpy as np
import pytest

from evg_app.errors import BadInput
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.bullet import connect, load_object
from evg_app.simulation.meshes import half_spaces, load_parts, merged, volume_and_center
from evg_app.simulation.objects import ANY_SCENE, objects_from_folder, of_kind, split_of
from evg_app.simulation.shapes import FAMILIES

SIZE_LIMITS_M = (0.005, 0.20)
GRASPABLE_M = 0.07
CENTER_TOLERANCE_M = 2e-5

CUBE = """o cube
v -0.02 -0.02 -0.02
v 0.02 -0.02 -0.02
v 0.02 0.02 -0.02
v -0.02 0.02 -0.02
v -0.02 -0.02 0.02
v 0.02 -0.02 0.02
v 0.02 0.02 0.02
v -0.02 0.02 0.02
f 4 3 2 1
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""
URDF = """<robot name="cube"><link name="base_link">
<inertial><mass value="0.1"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial>
<visual><geometry><mesh filename="cube_visual.obj"/></geometry></visual>
<collision><geometry><mesh filename="cube_collision.obj"/></geometry></collision>
</link></robot>"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "cube.urdf").write_text(URDF)
    (tmp_path / "cube_visual.obj").write_text(CUBE)
    (tmp_path / "cube_collision.obj").write_text(CUBE)
    return tmp_path


def test_training_and_test_objects_are_disjoint():
    train, test = builtin_objects("train"), builtin_objects("test")
    assert not {m.name for m in train} & {m.name for m in test}
    assert {split_of(m.name) for m in train} == {"train"}
    assert {split_of(m.name) for m in test} == {"test"}
    contents = [{m.collision_mesh.read_bytes() for m in half} for half in (train, test)]
    assert not contents[0] & contents[1]


@pytest.mark.parametrize("split", ["train", "test"])
def test_each_half_has_every_family_and_kind(split):
    objects = builtin_objects(split)
    assert {m.family for m in objects} == {*FAMILIES, "blob"}
    assert sum(m.family != "blob" for m in objects) >= 80
    assert sum(m.family == "blob" for m in objects) >= 150
    for kind in ANY_SCENE:
        assert len(of_kind(objects, kind)) >= 80


@pytest.mark.parametrize("split", ["train", "test"])
def test_sizes_are_realistic_and_mostly_graspable(split):
    sizes = np.array([m.extents for m in builtin_objects(split)])
    assert sizes.min() > SIZE_LIMITS_M[0] and sizes.max() < SIZE_LIMITS_M[1]
    assert (sizes.min(axis=1) < GRASPABLE_M).mean() > 0.95
    assert all(0.02 <= m.mass <= 0.40 for m in builtin_objects(split))


@pytest.mark.parametrize("split", ["train", "test"])
def test_every_object_loads_and_its_frame_is_its_center_of_mass(split):
    client = connect()
    try:
        for model in builtin_objects(split):
            body = load_object(client, model, 1.0, np.eye(4), visible=False)
            info = client.getDynamicsInfo(body, -1)
            assert info[0] == pytest.approx(model.mass, abs=1e-6)
            np.testing.assert_allclose(info[3], 0.0, atol=1e-9)
            low, high = np.array(client.getAABB(body))
            np.testing.assert_allclose(high - low, model.extents, atol=0.012)
            client.removeBody(body)
            _, center = volume_and_center(load_parts(model.collision_mesh))
            np.testing.assert_allclose(center, 0.0, atol=CENTER_TOLERANCE_M)
    finally:
        client.disconnect()


def test_parts_are_convex_and_closed():
    for model in builtin_objects("test")[::7]:
        for part, planes in zip(load_parts(model.collision_mesh), half_spaces(model.collision_mesh), strict=True):
            inside = part.vertices @ planes[:, :3].T + planes[:, 3]
            assert inside.max() < 1e-6
            edges = np.sort(part.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
            _, counts = np.unique(edges, axis=0, return_counts=True)
            assert (counts == 2).all()


def test_folder_of_urdfs_is_read(folder):
    (model,) = objects_from_folder(folder)
    assert model.name == "cube" and model.kinds == ANY_SCENE
    np.testing.assert_allclose(model.extents, 0.04)
    assert len(merged(load_parts(model.visual_mesh)).faces) == 12


def test_missing_and_empty_folders_are_named(tmp_path):
    with pytest.raises(BadInput, match="does not exist"):
        objects_from_folder(tmp_path / "nowhere")
    with pytest.raises(BadInput, match=r"holds no \.urdf"):
        objects_from_folder(tmp_path)


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("cube_collision.obj", "v 0 0 0\n", "no faces"),
        ("cube_collision.obj", "v a b c\n", "not a readable OBJ"),
        ("cube_visual.obj", "v 0 0 0\nf 1 2 3\n", "does not exist"),
        ("cube_visual.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite"),
        ("cube.urdf", "<robot", "not a readable URDF"),
        ("cube.urdf", "<robot/>", "one link and a mass"),
        ("cube.urdf", URDF.replace("0.1", "-1"), "mass"),
    ],
)
def test_broken_files_are_named(folder, file, content, message):
    (folder / file).write_text(content)
    with pytest.raises(BadInput, match=message) as caught:
        objects_from_folder(folder)
    assert file in str(caught.value)


def test_missing_mesh_is_named(folder):
    (folder / "cube_visual.obj").unlink()
    with pytest.raises(BadInput, match=r"cube_visual\.obj does not exist"):
        objects_from_folder(folder)


def test_unwritable_cache_says_what_to_do(tmp_path, monkeypatch):
    (tmp_path / "evg-app").write_text("a file where the folder should be")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(BadInput, match="XDG_CACHE_HOME"):
        builtin_objects("train")
