"""Block diagrams: what is to be shown, where it goes (computed), and the picture."""

from co_sim.diagram.blocks import Block, Diagram, Wire
from co_sim.diagram.layered import layered

__all__ = ["Block", "Diagram", "Wire", "layered"]
