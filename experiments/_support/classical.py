"""Criteria of classical experimental design: functions of the information matrix alone."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid._types import Scalar
from jaxid.design.criteria import Criterion
from jaxid.loop.record import rows_of
from jaxid.model.system import System, smoothed
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory


class InformationCriterion(Criterion):
    """A classical criterion for the design of a motion: D-, A- or E-optimality.

    Attributes:
        system: system with its regressors and disturbance bound δ.
        criterion: D, A or E, see `Information`.
    """

    system: System
    criterion: str = eqx.field(static=True)

    def near(self, task: Task, motion: JerkTrajectory) -> "Information":
        return self._with(task, 64)

    def coarse(self, task: Task, motion: JerkTrajectory) -> "Information":
        return self._with(task, 5)

    def _with(self, task: Task, nodes: int) -> "Information":
        speed = jnp.max(jnp.abs(task.limits.velocity))
        return Information(self.system, self.criterion, speed, nodes)


class Information(eqx.Module):
    """The log of the size of the least-squares covariance, if Δ were white noise of deviation δ.

    Parameters are relative to the prior box, so that their units do not matter. The whole motion is
    free: it is searched for this criterion, and the best of several such motions is the one with
    the smallest predicted half-widths.

    Attributes:
        system: system with its regressors and disturbance bound δ.
        criterion: D for the mean log axis of the error ellipsoid, A for the sum of the variances, E
            for the longest axis of the ellipsoid.
        speed: speed over which jumps are spread at smoothing 1, m/s or rad/s.
        nodes: number of nodes of the midpoint rule per interval of the motion.
    """

    system: System
    criterion: str = eqx.field(static=True)
    speed: Scalar = eqx.field(converter=jnp.asarray)
    nodes: int = eqx.field(static=True, default=5)

    def __check_init__(self) -> None:
        require(
            self.criterion in ("D", "A", "E"),
            f"Argument `criterion` must be D, A or E, but is {self.criterion!r}.",
        )

    def __call__(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
        """Return the log of the size; jumps are also spread over the speed change between nodes."""
        states, weights = trajectory.midpoints(self.nodes)
        step = jnp.abs(states.acceleration) * weights / 2
        rows = rows_of(smoothed(self.system, smoothing * self.speed + step), states, weights)
        return self._size(self._information(rows.regressors / rows.delta[:, None], rows.measure))

    def _information(
        self, phi: Float[Array, "n m"], measure: Float[Array, " n"]
    ) -> Float[Array, "m m"]:
        relative = phi * self.system.half_widths[None]
        return (relative * measure[:, None]).T @ relative

    def _size(self, P: Float[Array, "m m"]) -> Scalar:
        match self.criterion:
            case "D":
                return -jnp.linalg.slogdet(P)[1] / (2 * P.shape[0])
            case "A":
                return jnp.log(jnp.trace(jnp.linalg.inv(P))) / 2
            case _:
                return -jnp.log(jnp.linalg.eigvalsh(P)[0]) / 2
