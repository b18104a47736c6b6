"""How an exploring ground robot drives and decides."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from sitl.world.explorers.policies import RobotPolicyName

Positive = Annotated[float, Field(gt=0, le=1e9)]
AtLeastZero = Annotated[float, Field(ge=0, le=1e3)]
Share = Annotated[float, Field(ge=0, le=1)]
"""What a file may write where these stand."""

PlacedBy = Literal["town", "seed"]
"""Whether places are those of the town's file, or others in every run."""


class ExplorerSettings(BaseModel):
    """How a ground robot drives and decides; the defaults are the paper's and its authors' code.

    Attributes:
        speed_m_s: The most that it drives.
        progress: What it makes of that on a road on average, stops to observe and to plan included;
            elsewhere it is slower. The paper does not give the speed of its simulated robots; their
            code gives a goal up after 3 s per metre, in the simulation after 10 s.
        sight_m: It knows the ground within this distance of where it was.
        recognition_m: It recognises a vehicle within this distance, if no building is between.
        patience_s_m: It gives a goal up after so many seconds per metre of way.
        recall: Chance that a vehicle is recognised on maps, drawn for each one and run.
        located: Chance that a robot that has come to a goal, as it believes, finds the vehicle;
            else the team takes it for visited all the same.
        localisation_m: Mean error (Rayleigh) of where a robot takes itself to be, 0 for none. It
            finds the vehicle of a goal if it really is within `recognition_m` of it.
        stuck: Chance that a way to a goal is found to a place on it only, and the robot stands
            there until its patience is over.
        errors: `given`: as the settings have them. `published`: each run draws `recall` and
            `localisation_m` from what was published (`sitl.world.explorers.published_errors`).
        thinking_s: Without a goal it searches for one so often.
        idle: Without a goal: `return` to where it started and wait; `explore` what is unknown.
        policy: What may have it drive elsewhere (docs/evidence/town.md); None: nothing.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    speed_m_s: Positive = 1.5
    progress: Annotated[float, Field(gt=0, le=1)] = 0.2
    sight_m: Positive = 7.0
    recognition_m: Positive = 7.0
    patience_s_m: Positive = 10.0
    recall: Share = 1.0
    located: Share = 1.0
    localisation_m: AtLeastZero = 0.0
    stuck: Share = 0.0
    errors: Literal["given", "published"] = "given"
    thinking_s: Positive = 5.0
    idle: Literal["return", "explore"] = "return"
    policy: RobotPolicyName | None = None
