"""Textbook excitations as motions: one family each, with its free parameters.

Each family defines an acceleration over time, faded in and out as fast as the jerk limit allows. It
is sampled at the knots of the jerk and projected onto the boundary conditions, like every other
motion. All families but the last are added to a move there and back. One free parameter
interpolates between two such moves: the one with the largest margin to all limits, and the one that
spends most of its time at top speed. The free parameters z that a search varies are of order one.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._types import Scalar
from jaxid.motion.motion_space import MotionSpace
from jaxid.motion.trajectory import JerkTrajectory

Numbers = Float[Array, " d"]
Knots = Float[Array, " knots"]

_HIGHEST = 15.0  # Hz, highest first or last frequency: there the jerk limit permits a_max/4
# a shift register of five stages with feedback from the third: it takes every state but one
_REGISTER, _LENGTH = 5, 31


class Excitation(eqx.Module):
    """Base class of families of motions with free parameters z.

    Attributes:
        space: motion space onto which every member is projected.
        moves: jerk of the two moves there and back, m/s³, shape (2, n).
        peak: acceleration at amplitude one, m/s².
        edge: shortest time from amplitude −1 to 1, as a share of the duration.
    """

    space: MotionSpace
    moves: Float[Array, "2 n"]
    peak: Scalar = eqx.field(converter=jnp.asarray)
    edge: Scalar = eqx.field(converter=jnp.asarray)
    size: ClassVar[int]  # number of free parameters

    @abc.abstractmethod
    def acceleration(self, z: Numbers, phase: Knots) -> Knots:
        """Return the acceleration in units of `peak`, at times given as shares of the duration."""

    @property
    def duration(self) -> Scalar:
        """The duration of the motions, s."""
        return jnp.sum(self.space.durations)

    def trajectory(self, z: Numbers) -> JerkTrajectory:
        """Return the motion with the free parameters z."""
        durations = self.space.durations
        times = jnp.concatenate([jnp.zeros(1), jnp.cumsum(durations)])
        phase = times / self.duration
        faded = jnp.clip(2 * jnp.minimum(phase, 1 - phase) / self.edge, 0.0, 1.0)
        added = self.peak * faded * self.acceleration(z, phase)
        jerk = self.move(z[-1]) + jnp.diff(added) / durations
        return self.space.trajectory(self.space.coordinates(jerk))

    def move(self, z: Scalar) -> Float[Array, " n"]:
        """Return the jerk of the move that is added, m/s³, for the last free parameter."""
        gentle, fast = self.moves
        return gentle + jax.nn.sigmoid(z) * (fast - gentle)

    def cycles(self, z: Scalar) -> Scalar:
        """Return the number of cycles per motion: between one and that of the highest frequency."""
        share = jax.nn.sigmoid(2.0 * z)
        return (_HIGHEST * self.duration) ** share


class Chirp(Excitation):
    """A sine whose frequency and amplitude change in proportion to time.

    Free parameters: first and last frequency, first and last amplitude, phase, move.
    """

    size = 6

    def acceleration(self, z: Numbers, phase: Knots) -> Knots:
        first, last = self.cycles(z[0]), self.cycles(z[1])
        turns = first * phase + (last - first) * phase**2 / 2 + z[4]
        return (z[2] + (z[3] - z[2]) * phase) * jnp.sin(2 * jnp.pi * turns)


class Multisine(Excitation):
    """Eight harmonics of equal amplitude.

    Free parameters: base frequency, amplitude, eight phases (Schroeder's phases are one choice of
    them), move.
    """

    size = 11

    def acceleration(self, z: Numbers, phase: Knots) -> Knots:
        k = jnp.arange(1, 9)
        turns = self.cycles(z[0]) / 4 * jnp.outer(phase, k) + z[None, 2:10]
        return z[1] * jnp.mean(jnp.sin(2 * jnp.pi * turns), axis=1)


class Fourier(Excitation):
    """A finite Fourier series (J. Swevers et al., "Optimal robot excitation", 1997).

    Free parameters: base frequency, eight coefficients each of sines and cosines, move.
    """

    size = 18

    def acceleration(self, z: Numbers, phase: Knots) -> Knots:
        k = jnp.arange(1, 9)
        angle = 2 * jnp.pi * self.cycles(z[0]) / 4 * jnp.outer(phase, k)
        return (jnp.sin(angle) @ z[1:9] + jnp.cos(angle) @ z[9:17]) / 4


class PRBS(Excitation):
    """A pseudo-random binary sequence of length 31.

    At full amplitude its edges are as steep as the jerk limit allows. Free parameters: clock
    period, start within the sequence, amplitude, mean, move.
    """

    size = 5

    def acceleration(self, z: Numbers, phase: Knots) -> Knots:
        bits = jnp.asarray(_register())
        at = phase * 2 * self.cycles(z[0]) + _LENGTH * z[1]
        number = jnp.floor(at)
        width = jnp.minimum(self.edge * 2 * self.cycles(z[0]), 1.0)
        share = jnp.clip((at - number - 1 + width) / width, 0.0, 1.0)
        index = number.astype(int) % _LENGTH
        now, after = bits[index], bits[(index + 1) % _LENGTH]
        return z[2] * (now + (after - now) * share) + z[3]


class BangBang(Excitation):
    """Full acceleration in alternating directions, with free switching times.

    At full acceleration its edges are as steep as the jerk limit allows. Free parameters: the two
    levels and eleven switching times. It moves there and back by itself, so no move is added.
    """

    size = 14

    def move(self, z: Scalar) -> Float[Array, " n"]:
        return jnp.zeros_like(self.moves[0])

    def acceleration(self, z: Numbers, phase: Knots) -> Knots:
        switches = jnp.cumsum(jax.nn.softmax(2.0 * z[2:]))[:-1]
        signs = (-1.0) ** jnp.arange(switches.size + 1)
        levels = jnp.where(signs > 0, jnp.abs(z[0]), -jnp.abs(z[1]))
        steps = jnp.clip((phase[:, None] - switches[None]) / self.edge + 0.5, 0.0, 1.0)
        return levels[0] + steps @ jnp.diff(levels)


def _register() -> list[float]:
    """Return one period of the sequence, as ±1."""
    state, bits = [1.0] * _REGISTER, []
    for _ in range(_LENGTH):
        bits.append(state[-1])
        state = [state[4] * state[2] * -1.0, *state[:-1]]
    return bits
