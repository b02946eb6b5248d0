"""From commanded body rates to demanded torque. Paper (44)."""

from __future__ import annotations

from fcu.kernel.compile import kernel
from fcu.laws.mmrac.prediction import couplings


@kernel
def f_wc(c_rate, estimates, w, w_c, Omega_m):
    """f_pc, f_qc, f_rc (rad/s^2): demanded angular acceleration less what is estimated to act.

    The demanded torque is J_hat times this. Paper (44).
    """
    return c_rate * (w_c - w) - couplings(estimates, w, Omega_m) - estimates.s_w_hat  # (44)
