"""Trains an LSTM and a perceptron that know nothing of rigid bodies, as black-box baselines.

Both give accelerations from positions, speeds and torques; the LSTM remembers what it saw since its
rollout began. They are trained as the friction is: first on accelerations, then over rollouts of
0.5 s from measured states, on the same losses, with the weights that are best in validation.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np
import torch
from evaluate import SAMPLE_TIME, Array, Episode, Windows, windows
from torch import Tensor, nn

HIDDEN = 64
STRIDE = 25
BATCH = 50
UPDATES = {"accelerations": 250, "rollouts": 150}
RATES = {"accelerations": 5e-3, "rollouts": 2e-3}
WATCHED = 10
"""Updates from one look at the validation episodes to the next."""
State = tuple[Tensor, Tensor] | None


class Perceptron(nn.Module):
    """Two hidden layers between the features of a sample and its accelerations."""

    def __init__(self) -> None:
        super().__init__()
        first, second = nn.Linear(24, HIDDEN), nn.Linear(HIDDEN, HIDDEN)
        self.layers = nn.Sequential(first, nn.Tanh(), second, nn.Tanh(), nn.Linear(HIDDEN, 6))

    def forward(self, features: Tensor, state: State) -> tuple[Tensor, State]:
        return self.layers(features), state


class Memory(nn.Module):
    """An LSTM, whose state is 0 where a rollout begins."""

    def __init__(self) -> None:
        super().__init__()
        self.cell, self.last = nn.LSTMCell(24, HIDDEN), nn.Linear(HIDDEN, 6)

    def forward(self, features: Tensor, state: State) -> tuple[Tensor, State]:
        seen, cell = self.cell(features, state)
        return self.last(seen), (seen, cell)


KINDS = {"LSTM": Memory, "MLP": Perceptron}


class Network:
    """A trained black box."""

    def __init__(self, kind: str, train: Sequence[Episode], val: Sequence[Episode]) -> None:
        torch.set_num_threads(1)
        torch.manual_seed(0)
        ddq = np.concatenate([np.diff(e["dq"], axis=0) for e in train]) / SAMPLE_TIME
        self._mean, self._scale = _tensor(ddq.mean(axis=0)), _tensor(ddq.std(axis=0))
        self._module = KINDS[kind]()
        given, watched = windows(train, STRIDE), windows(val)
        generator = torch.Generator().manual_seed(1)
        for stage, updates in UPDATES.items():
            optimizer = torch.optim.Adam(self._module.parameters(), RATES[stage])
            schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, updates)
            best, kept = np.inf, copy.deepcopy(self._module.state_dict())
            for update in range(updates):
                chosen = torch.randperm(given.q.shape[1], generator=generator)[:BATCH].numpy()
                loss = self._loss(_only(given, chosen), stage)
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(self._module.parameters(), 1.0)
                optimizer.step()
                schedule.step()
                if (update + 1) % WATCHED == 0:
                    with torch.no_grad():
                        now = float(self._loss(watched, stage))
                    if now < best:
                        best, kept = now, copy.deepcopy(self._module.state_dict())
            self._module.load_state_dict(kept)

    def simulated(self, given: Windows) -> Array:
        """The positions along each rollout."""
        with torch.no_grad():
            return self._rollout(given)[0].numpy().astype(float)

    def _loss(self, given: Windows, stage: str) -> Tensor:
        if stage == "accelerations":
            return torch.mean(self._one_step(given) ** 2)
        q, dq = self._rollout(given)
        return 100 * torch.mean((q - _tensor(given.q)) ** 2) + torch.mean(
            (dq - _tensor(given.dq)) ** 2
        )

    def _one_step(self, given: Windows) -> Tensor:
        """The scaled errors of accelerations, each from a measured state."""
        q, dq = (
            torch.cat([_tensor(first)[None], _tensor(later)])
            for first, later in ((given.q0, given.q), (given.dq0, given.dq))
        )
        features = _features(q[:-1], dq[:-1], _tensor(given.tau))
        state: State = None
        found: list[Tensor] = []
        for at_once in features if isinstance(self._module, Memory) else [features]:
            ddq, state = self._module(at_once, state)
            found.append(ddq.reshape(-1, 6))
        measured = (dq[1:] - dq[:-1]) / SAMPLE_TIME
        return torch.cat(found) - ((measured - self._mean) / self._scale).reshape(-1, 6)

    def _rollout(self, given: Windows) -> tuple[Tensor, Tensor]:
        q, dq = _tensor(given.q0), _tensor(given.dq0)
        state: State = None
        positions: list[Tensor] = []
        speeds: list[Tensor] = []
        for tau in _tensor(given.tau):
            ddq, state = self._module(_features(q, dq, tau), state)
            after = dq + SAMPLE_TIME * (self._mean + self._scale * ddq)
            q, dq = q + SAMPLE_TIME * (dq + after) / 2, after
            positions.append(q)
            speeds.append(dq)
        return torch.stack(positions), torch.stack(speeds)


def _features(q: Tensor, dq: Tensor, tau: Tensor) -> Tensor:
    """Of about the same size."""
    return torch.cat([torch.sin(q), torch.cos(q), dq, tau / 10], dim=-1)


def _only(given: Windows, chosen: np.ndarray) -> Windows:
    along = (values[:, chosen] for values in (given.tau, given.q, given.dq))
    return Windows(given.q0[chosen], given.dq0[chosen], *along)


def _tensor(values: Array) -> Tensor:
    return torch.from_numpy(np.asarray(values, dtype=np.float32))
