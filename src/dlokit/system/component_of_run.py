"""How a started process makes its components: from the configuration file of the run."""

from pathlib import Path

from dlokit.communication.component import Component
from dlokit.system.build import Wiring, build_component
from dlokit.system.child_spec import ChildSpec
from dlokit.system.config import RunConfig
from dlokit.system.joined_bus import JoinedBus
from dlokit.system.start_file import NOBODYS_BUSINESS, read_start
from dlokit.system.toml_config import read_toml


def component_of_run(name: str, spec: ChildSpec, bus: JoinedBus) -> Component:
    """The component of that name from the run's configuration file."""
    wiring = Wiring(
        transport=bus.transport,
        clock=bus.clock,
        folder=Path(spec.run_dir),
        start_nodes_world=read_start(Path(spec.run_dir)) if name == "cell" else NOBODYS_BUSINESS,
        page_key=spec.page_key,
    )
    return build_component(name, read_toml(Path(spec.config_file), RunConfig), wiring)
