"""Shuffles an epoch's rollouts with a counter-based generator, so that resuming is exact."""

from __future__ import annotations

import numpy as np

from msnn.data.dataset import IntArray

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)


def order_key(seed: int, stage: int, epoch: int, attempt: int = 0) -> int:
    """The 64-bit key that determines the order of one epoch."""
    source = np.random.SeedSequence([seed, stage, epoch, attempt])
    return int(source.generate_state(1, np.uint64)[0])


def shuffled(count: int, key: int) -> IntArray:
    """The integers 0 … count−1 in an order determined by a key, count < 2³².

    The inside-out form of the Fisher-Yates shuffle (Knuth, The Art of Computer Programming 2,
    algorithm P), with draws of SplitMix64 (Steele, Lea, Flood: Fast Splittable Pseudorandom Number
    Generators, OOPSLA 2014). Kernels do the same in C (templates/native/epochs.c).
    """
    order = list(range(count))
    for i, j in enumerate(_draws(count, key).tolist()):
        order[i] = order[j]
        order[j] = i
    return np.array(order, np.int64)


def _draws(count: int, key: int) -> IntArray:
    """For each i < count, a random integer in 0 … i."""
    numbers = np.arange(1, count + 1, dtype=np.uint64)
    bits = np.uint64(key) + numbers * _GOLDEN  # modulo 2⁶⁴, as all of it
    bits = (bits ^ (bits >> np.uint64(30))) * _FIRST
    bits = (bits ^ (bits >> np.uint64(27))) * _SECOND
    bits ^= bits >> np.uint64(31)
    return (((bits >> np.uint64(32)) * numbers) >> np.uint64(32)).astype(np.int64)
