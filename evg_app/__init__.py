"""evg-app: pick real objects off a real table with equivariant volumetric grasping.

Rooms (each imports only from the floors below it): values (`geometry`, `errors`, `types`,
`clock`, `events`) < `config` < capabilities (`nets`, `perception`, `grasping`, `motion`,
`cameras`, `robots`, `simulation`, `trials`) < `picking`, `learning` < `cli`.
"""

__version__ = "0.1.0"
