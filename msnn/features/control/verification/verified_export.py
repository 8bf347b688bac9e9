"""Controllers and estimators, as `msnn verify` checks them."""

from __future__ import annotations

from collections.abc import Iterator

from msnn.errors.targets import no_controller_on_board
from msnn.features.control.verification.board import online_board_checks
from msnn.features.control.verification.exported_controller import (
    ExportedController,
    damaged_part,
    read_exported_controller,
)
from msnn.features.control.verification.host import no_proof, online_fuzz_check, online_host_checks
from msnn.verification.host_checks import misra_check
from msnn.verification.proof_step import ProofStep
from msnn.verification.verify import VerifiedExport, WantedSteps


def _checks(model: ExportedController, wanted: WantedSteps) -> Iterator[ProofStep]:
    if "host" in wanted.targets:
        yield from online_host_checks(model)
    yield from online_board_checks(model, wanted.targets)
    if wanted.misra:
        yield misra_check(model)
    if wanted.proof:
        yield no_proof(model)
    if wanted.fuzz:
        yield online_fuzz_check(model, wanted.fuzz)


CONTROLLERS = VerifiedExport(
    read=read_exported_controller,
    damaged_part=damaged_part,
    target="mpc",
    checks=_checks,
    on_board=no_controller_on_board,
)
