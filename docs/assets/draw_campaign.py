"""Draw which gains cross at which speed: python docs/assets/draw_campaign.py

The same 3744 flights as the command in docs/how-to/simulate-flight.md; a few minutes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from benchtool.core.rig_file import rig_named
from benchtool.data.run.campaign import write_campaign
from benchtool.report.figure import drawn
from benchtool.report.files import save_figure
from benchtool.report.flight.campaign import campaign_map
from benchtool.simulate.campaign_flight import OGE, flight_campaign
from benchtool.simulate.design import Design
from benchtool.simulate.flight.cases import GYRO_NOISE_RAD_S
from benchtool.simulate.flight.setup import FlightSetup
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import gains_named

TARGET = Path(__file__).parent / "flight-campaign"

FLIGHT = FlightSetup(
    case="over",
    vehicle=FlightVehicle.of_rig(rig_named("pquad")),
    gains=gains_named("s3"),
    duration_s=120.0,
    gyro_noise_rad_s=GYRO_NOISE_RAD_S,
)
CAMPAIGN = flight_campaign(
    {name: replace(FLIGHT, gains=gains_named(name)) for name in ("s3", "s1a", "stiff")},
    (OGE, "pid"),
)
DESIGN = Design.read(["speed_m_s=0.1:1.2:12", "gains.attitude=0.6:1.8:13"], seeds=4, seed=1)

if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        table = Path(folder) / "campaign.parquet"
        write_campaign(CAMPAIGN.rows(DESIGN), table, {})
        cells = campaign_map(table, CAMPAIGN, DESIGN, "arrives")
    block = drawn("flight.campaign", cells)["campaign"]
    for path in save_figure(block.figure, TARGET, ("svg",), replace=True):
        print(path)
