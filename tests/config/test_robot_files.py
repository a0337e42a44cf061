"""Robot files are found in installed data packages or as plain paths; what is missing is named."""

import pytest

from evg_app.config.robot_files import collision_urdf, package_folder, resolve
from evg_app.errors import BadInput

PANDA = "example-robot-data:panda_description/urdf/panda.urdf"


def test_the_packaged_panda_is_found_with_its_meshes_and_primitives():
    urdf = resolve(PANDA)
    assert urdf.name == "panda.urdf"
    mesh = "example-robot-data/robots/panda_description/meshes/collision/hand.stl"
    assert (package_folder(urdf) / mesh).is_file()
    assert collision_urdf(urdf).name == "panda_collision.urdf"


def test_a_plain_path_is_used_as_it_is(tmp_path):
    urdf = tmp_path / "arm.urdf"
    urdf.write_text("<robot name='arm'/>")
    assert resolve(str(urdf)) == urdf
    assert package_folder(urdf) == tmp_path
    assert collision_urdf(urdf) == urdf


@pytest.mark.parametrize("uri", ["example-robot-data:none/none.urdf", "no/such/file.urdf", "other-package:arm.urdf"])
def test_a_missing_file_is_named(uri):
    with pytest.raises(BadInput, match=uri.replace("/", ".")):
        resolve(uri)
