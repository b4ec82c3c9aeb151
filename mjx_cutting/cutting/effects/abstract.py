"""What an effect is: a small frozen module that overrides the stage of the force path it acts at.

The path is spindle -> chip -> edge -> tool -> structure -> sensor. `ForceModel` calls every hook of every
effect in that order; a hook that an effect does not override is the identity. Parameters are array leaves, so
an effect can be jitted, vmapped and differentiated, and tracing can fit it.

An effect with memory keeps it in a state that the caller carries: `init` makes it, `respond` advances it
under the force of the instant. One whose memory acts back on the force (chatter through the chip, droop
through the angle) also sets `coupled`: `recall` then binds the memory into a copy of the effect before the
force of each instant is computed. Without a state (in `process_force`) such an effect shows what it does at
rest.

To add an effect of your own: one file, one class, one decorator.

    @register
    class Wobble(AbstractEffect):
        name = "wobble"
        stage = "tool"
        strength = "force_n"
        parameters = {"force_n": Parameter("N", 0.0, 50.0, identity=0.0, typical=1.0)}
        force_n: ArrayLike

        def body(self, force, cut, model):
            return force.at[..., 0].add(self.force_n * jnp.sin(cut.angle_rad))
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting.chip import Chip, Cutter
from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.material import Material
from mjx_cutting.cutting.tool import Tool

if TYPE_CHECKING:
    from mjx_cutting.cutting.model import ForceModel

STAGES = ("spindle", "chip", "edge", "tool", "structure", "sensor")


class Parameter(NamedTuple):
    """One physical parameter of an effect.

    Fields:
        unit: SI unit, "1" when there is none.
        low, high: physical range; a fit at or beyond an end of it is refused, so it reaches a little further
            than what was published (`source`).
        identity: value at which the effect vanishes, or None when the parameter only shapes it.
        typical: scale of a usual value; the fit works in units of it.
        log: True when the fit should work on the logarithm (positive, over decades).
        per_tooth: True for one value a tooth, [N].
        whole: True for a whole number, which a fit finds by trying each and does not move.
        length: number of values when the parameter is a vector (3: one for each axis); 0 for a scalar.
        source: where the range comes from.
    """

    unit: str
    low: float
    high: float
    identity: float | None = None
    typical: float = 1.0
    log: bool = False
    per_tooth: bool = False
    source: str = ""
    length: int = 0
    whole: bool = False

    def shape(self, tool: Tool) -> tuple[int, ...]:
        """Shape of the value for this tool."""
        return (tool.teeth,) if self.per_tooth else (self.length,) if self.length else ()


class EdgeForce(NamedTuple):
    """Local force on each edge element, tangential, radial and axial, in newtons for full contact.

    Fields: `chip` [..., S, N, 3] the part that shears the chip, `edge` [..., S, N, 3] the part that rubs.
    """

    chip: Array
    edge: Array


class AbstractEffect(eqx.Module):
    """Base of all effects; override the hooks of your stage only.

    Class attributes:
        name: name in code, files and verdicts.
        stage: one of `STAGES`.
        strength: the parameter that is the effect's size.
        parameters: description of every field.
        telling: further parameters without which the effect would be another one: where the intervals of all
            of them hold their identity, nothing is named.
        sharp: parameters that the effect, where it is there, leaves no doubt of: nothing is named where one
            is not known to a factor of two.
        held: parameters read from the trials rather than fitted, with the ends of what these leave open.
        needs: covariates that must be in the data for the effect to be testable ("joint velocity", ...).
        steady: False where one revolution under given conditions does not hold the effect (it lives in
            position, in time or at frequencies of its own): fit it on the record, by `ForceModel.predict`.
        coupled: True where the effect's memory acts back on the process force, see `recall`.
        per_turn: True where `spindle` and `engage` change only what holds for a whole turn (speed, depth,
            arc), and what varies within it is in `ahead`: its lines are found without sampling the turn.
        swings: True where the spindle's speed follows the torque within the turn: `swung` binds that.
        alike: True where `chip` and `edge` do the same to every tooth that cuts the same chip at the same
            angle: while the teeth are alike, lines are found from one of them.
        idle_teeth: True where `chip` takes one tooth or more out of the cut: the mean load is then that of
            every tooth by itself.
        evens_out: True where `edge` gives each tooth more or less than the others, and nothing to their
            mean: the mean load is taken without it.
        damps: True where all that the effect does is to take energy from the lines, most from the highest.
        by_position: True where `transfer` changes along the path (`Cut.position_m`): what a record shows is
            its mean over the stretch.
        only_axis: index of the one axis of force that the effect changes: the others show the constants
            without it. None where it changes several.
        most: how many of the kind one tool may show at once, each with parameters of its own.
        physical: False for what is no missing cause (a term that fits without saying why, plain geometry);
            tracing never names it.
        signature: one sentence, what it leaves in a residual.
        confused_with: other effects and what separates them from this one.
    """

    name: ClassVar[str] = ""
    stage: ClassVar[str] = ""
    strength: ClassVar[str] = ""
    parameters: ClassVar[dict[str, Parameter]] = {}
    telling: ClassVar[tuple[str, ...]] = ()
    sharp: ClassVar[tuple[str, ...]] = ()
    held: ClassVar[dict[str, tuple[float, float]]] = {}
    needs: ClassVar[tuple[str, ...]] = ()
    steady: ClassVar[bool] = True
    coupled: ClassVar[bool] = False
    per_turn: ClassVar[bool] = False
    swings: ClassVar[bool] = False
    alike: ClassVar[bool] = False
    idle_teeth: ClassVar[bool] = False
    evens_out: ClassVar[bool] = False
    damps: ClassVar[bool] = False
    by_position: ClassVar[bool] = False
    only_axis: ClassVar[int | None] = None
    most: ClassVar[int] = 1
    physical: ClassVar[bool] = True
    signature: ClassVar[str] = ""
    confused_with: ClassVar[dict[str, str]] = {}

    # -- hooks, in the order of the path; each gets the value of the stage before

    def spindle(self, cut: Cut, model: ForceModel) -> Cut:
        """Angle, speed and feed as they really are."""
        return cut

    def ahead(self, angle_rad: ArrayLike) -> Array | None:
        """[...] how far the tool is ahead of `angle_rad`, which turns evenly, rad; None where it is not."""
        return None

    def swung(self, torque: Array, cut: Cut, model: ForceModel) -> AbstractEffect:
        """This effect with its answer bound to the torque of the turn, complex lines [n + 1] over the angle
        of tooth 0, N m, which the model has without it."""
        return self

    def engage(self, cut: Cut, force: Callable[[Cut], Array], model: ForceModel) -> Cut:
        """Depth and arc as a compliant structure leaves them; `force(cut)` is the process force [..., 3]."""
        return cut

    def cutter(self, cutter: Cutter, model: ForceModel) -> Cutter:
        """Where the teeth really are."""
        return cutter

    def chip(self, chip: Chip, cut: Cut, model: ForceModel) -> Chip:
        """Chip thickness and contact, [..., S, N]."""
        return chip

    def arcs(self, cut: Cut, model: ForceModel) -> Sequence[tuple[Array, Cut]] | None:
        """Cuts over parts of the arc, of which, each with its share, the force under `chip` is the sum, for
        lines exact where a part ends; None for an effect that does not part it."""
        return None

    def constants(self, material: Material, cut: Cut, model: ForceModel) -> Material:
        """Mechanistic constants of what is cut there."""
        return material

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        """Local force law."""
        return force

    def body(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        """Forces [..., 3] on the tool as a whole, N."""
        return force

    def brake(self, torque: Array, cut: Cut, model: ForceModel) -> Array:
        """Torque [...] that resists the spindle, N m, beside the edges' own."""
        return torque

    def sense(self, force: Array, cut: Cut, model: ForceModel) -> Array:
        """What the transducer makes of the force [..., 3] at that instant, N."""
        return force

    # -- memory

    def init(self, model: ForceModel) -> Any:
        """State at rest; () for an effect without memory."""
        return ()

    def recall(self, state: Any, cut: Cut, dt_s: ArrayLike, model: ForceModel) -> AbstractEffect:
        """This effect with its memory bound, for the instant in the middle of the coming `dt_s`."""
        return self

    def respond(
        self, state: Any, force: Array, cut: Cut, dt_s: ArrayLike, model: ForceModel
    ) -> tuple[Any, Array]:
        """Advance the state by `dt_s` under the force [3]; returns the state and the force passed on."""
        return state, force

    def transfer(self, frequency_hz: ArrayLike, cut: Cut, model: ForceModel) -> Array | None:
        """[F, 3, 3] complex response to a steady line at each frequency; None without memory."""
        return None

    # -- coordinates the fit works in

    @classmethod
    def size(cls, tool: Tool) -> int:
        """Number of free coordinates for this tool."""
        return sum(int(np.prod(p.shape(tool))) for p in cls.parameters.values())

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> AbstractEffect:
        """The effect at [size] fit coordinates; zero strength coordinates give the identity."""
        values, start = [], 0
        for parameter in cls.parameters.values():
            shape = parameter.shape(tool)
            count = int(np.prod(shape))
            part = coordinates[start : start + count]
            value = parameter.typical * (jnp.exp(part) if parameter.log else part)
            if parameter.identity is not None and not parameter.log:
                value = parameter.identity + value
            values.append(value.reshape(shape))
            start += count
        return cls(*values)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        """[n, size] starting points of the fit, in coordinates; the default is one typical value."""
        start: list[float] = []
        for parameter in cls.parameters.values():
            count = int(np.prod(parameter.shape(tool)))
            start += [0.0 if parameter.log else 0.3] * count
        return np.asarray([start])

    @classmethod
    def again(cls, coordinates: np.ndarray, tool: Tool) -> np.ndarray:
        """[n, size] where else to start from than at `coordinates` [size], which a fit has reached and which
        may be the lesser of several optima; default nowhere."""
        return np.zeros((0, cls.size(tool)))

    @classmethod
    def identity(cls, tool: Tool) -> AbstractEffect:
        """The effect at no strength: the force path is left as it was."""
        values = []
        for parameter in cls.parameters.values():
            value = parameter.identity if parameter.identity is not None else parameter.typical
            shape = parameter.shape(tool)
            values.append(jnp.full(shape, value) if shape else value)
        return cls(*values)

    def values(self) -> dict[str, Any]:
        """Parameter values by name."""
        return {name: getattr(self, name) for name in self.parameters}
