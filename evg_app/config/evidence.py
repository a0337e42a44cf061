"""How a grasp is judged, and what contact on the approach means."""

from typing import Annotated, Literal

from pydantic import Field

from evg_app.config.base import Model, Positive


class EvidenceModel(Model):
    """Signs that something is held, beside the opening (`gripper.held_width_m`, `gripper.open_margin_m`).

    Attributes:
        check_empty_hand: without a referee, close the fingers once more after they opened above the bin: what sticks to
            one of them stops them.
        look_at_place: without a referee, look once more after the pick whether the object has left its place.
        place_radius_m: around where the fingers closed.
        place_depth_m: depth must have changed by more than this.
        place_area_m2: surface that must have changed for an object to be gone.
        place_compared: share of that surface that must be visible for the look to count.
    """

    check_empty_hand: bool = True
    look_at_place: bool = True
    place_radius_m: Positive = 0.04
    place_depth_m: Positive = 0.008
    place_area_m2: Positive = 1.0e-4
    place_compared: Annotated[float, Field(ge=0, le=1)] = 0.3


class ContactModel(Model):
    """The contact guard of the approach (a software limit, not a safety function); its force is `contact_force_n`.

    Attributes:
        bias_s: how long the force is averaged at rest before the approach; payload and gravity make it non-zero.
        then: "back_off" the way it came, or "close" the fingers where it touched (as the paper does).
    """

    bias_s: Annotated[float, Field(ge=0, le=2)] = 0.1
    then: Literal["back_off", "close"] = "back_off"
