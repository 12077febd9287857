"""A device that moves its own plate, as a stage."""

from benchtool.bench.drivers import open_bench
from benchtool.bench.stage.stage import DeviceStage


def test_a_device_may_be_its_own_stage():
    device = open_bench("sim:pquad_single")
    with device:
        reached_m = DeviceStage(device).move(0.9, 0.0, 0.0, lambda duration_s: None)
        shown = device.read(0.1)
    names = [channel.name for channel in device.identity.channels]
    assert reached_m == shown.values[-1, names.index("plate_z_m")] == 0.9
