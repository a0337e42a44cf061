"""`run` picks objects of the test half; the data engine builds scenes of the other half only."""

from evg_app.cli.lab import build_lab
from evg_app.config.files import load_camera, load_robot, load_world
from evg_app.learning.pools import object_pools
from evg_app.simulation.objects import split_of


def test_run_uses_the_test_half():
    lab = build_lab(load_robot("panda"), load_camera("d435i"), load_world("pile"), None, gui=False, speed=None)
    names = {model.name for model in lab.world.objects}
    lab.world.close()
    assert len(names) > 100
    assert {split_of(name) for name in names} == {"test"}


def test_training_uses_the_other_half():
    for validation in (False, True):
        pools = object_pools((), (), validation)
        names = {model.name for sets in pools.values() for objects in sets for model in objects}
        assert len(names) > 50
        assert {split_of(name) for name in names} == {"train"}
