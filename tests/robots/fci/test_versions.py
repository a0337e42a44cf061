"""Every refusal to connect ends in a sentence that says what to do."""

import pytest

from evg_app.robots.fci.versions import connect_advice

HOST = "172.16.0.2"


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("libfranka: Incompatible library version (server version: 5, library version: 10).", "Panda"),
        ("libfranka: Incompatible library version (server version: 9, library version: 10).", "pylibfranka=="),
        (
            "libfranka: Connection to FCI refused. Please install FCI feature or enable FCI mode in Desk.",
            "activate FCI",
        ),
        ("libfranka: unable to set realtime scheduling: Operation not permitted", "realtime: ignore"),
        ("libfranka: Connection timeout", f"ping {HOST}"),
        ("something new", f"ping {HOST}"),
    ],
)
def test_advice_fits_the_refusal(text, wanted):
    assert wanted in connect_advice("NetworkException", text, HOST)


def test_a_missing_package_names_the_extra():
    assert connect_advice("ImportError", "No module named 'pylibfranka'", HOST) == "Run: ./setup.sh franka"
