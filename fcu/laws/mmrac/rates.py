"""From commanded body rates to demanded torque. Paper (44)."""

from __future__ import annotations

from fcu.kernel.compile import kernel
from fcu.laws.mmrac.prediction import couplings


@kernel
def f_wc(params, state, w, w_c, Omega_m):
    """f_pc, f_qc, f_rc (rad/s^2): demanded angular acceleration less what is estimated to act.

    The demanded torque is J_hat times this. Paper (44).
    """
    return params.c_rate * (w_c - w) - couplings(state, w, Omega_m) - state.s_w_hat  # (44)
