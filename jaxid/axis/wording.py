"""Messages of the library in the words of the axis file, the log and the command line."""

import re

# by the name of an argument: what the reader of a file wrote
_ENTRIES = {
    "acceleration": "`limits.acceleration`",
    "at": "`at` in [[motion.via]]",
    "beta": "`beta`",
    "blend": "`blend`",
    "boundary": "[motion]",
    "delay": "`input.delay`",
    "epsilon": "`controller.epsilon`",
    "fast": "`disturbance.level`",
    "folder": "The folder",
    "gamma": "`controller.gamma`",
    "home": "`motion.home`",
    "input": "`limits.input`",
    "input_rate": "`limits.input_rate`",
    "interval": "`interval`",
    "intervals": "`motion.duration`",
    "jerk": "`limits.jerk`",
    "k1": "`controller.k1`",
    "k2": "`controller.k2`",
    "kd": "`controller.kd`",
    "kp": "`controller.kp`",
    "level": "`disturbance.level`",
    "limits": "[limits]",
    "log": "The log",
    "logs": "The log",
    "lower": "`lower` in [[motion.via]]",
    "name": "The name of a parameter",
    "parts": "The log",
    "path": "The file name",
    "period": "`servo.period`",
    "pitch": "`pitch`",
    "position": "`limits.position`",
    "recorded": "The log",
    "resolution": "`servo.resolution`",
    "slow": "`disturbance.slow`",
    "start": "`motion.start`",
    "terms": "[[terms]]",
    "threshold": "`disturbance.threshold`",
    "velocity": "`limits.velocity`",
    "velocity_error": "`servo.velocity_error`",
}
_ARGUMENT = re.compile(r"Arguments? `(\w+)`(?: of an? (?:\w+ )+?(?=must|has))?")


def in_words_of_files(sentence: str) -> str:
    """Return a message with entries of the axis file in place of arguments of Python functions.

    Args:
        sentence: message of an error of the library, such as "Argument `input` must …".
    """

    def entry(found: re.Match[str]) -> str:
        known = _ENTRIES.get(found[1])
        if known is None:
            return found[0]
        return f"{known} " if found[0].endswith(" ") else known

    return _ARGUMENT.sub(entry, sentence)
