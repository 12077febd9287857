"""Robust losses: weights of points, and robust scale and chi-square."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchtool.core.choices import Loss
from benchtool.core.units import Array

LOSSES: tuple[Loss, ...] = ("linear", "soft_l1", "huber")

HUBER_LIMIT = 1.345  # standard errors from which huber is linear: 95 % efficiency (Huber 1964)
# Variance inflation without outliers: mean(psi^2) / mean(psi')^2 over the normal distribution,
# integrated numerically. With stated errors it is the lower limit.
NORMAL_INFLATION: dict[Loss, float] = {"soft_l1": 1.0790, "huber": 1.0526}

MAD_TO_SD = 1.4826  # standard deviation of a normal distribution over its median absolute deviation

MAD_EFFICIENCY = 0.37  # on normal residuals (Rousseeuw, Croux, J. Am. Stat. Assoc. 88, 1993)


def robust_scale(rows: Array, dof: float) -> float:
    """Return the scatter of normalised residuals (m,) from their median absolute value."""
    return MAD_TO_SD * float(np.median(np.abs(rows))) * float(np.sqrt(len(rows) / max(dof, 1)))


def robust_chi2(rows: Array, dof: float) -> float:
    """Return the chi-square of residuals (m,) from their robust scale, without outliers.

    Its distribution is a scaled chi-square of `MAD_EFFICIENCY` times the degrees of freedom: in 600
    simulated fits of 10 to 100 points, 0.6 to 1.0 % are beyond the quantile of 1 %.
    """
    return max(dof, 0.0) * robust_scale(rows, dof) ** 2


def point_losses(loss: Loss, m: int) -> Callable[[Array], Array]:
    """Return rho (3, rows) of the squared rows: robust for m points, linear for the others.

    Both as defined by scipy; the change from quadratic to linear is at one standard error for
    soft_l1 and at `HUBER_LIMIT` for huber.
    """
    limit2 = HUBER_LIMIT**2 if loss == "huber" else 1.0

    def rho(squares: Array) -> Array:
        z = squares / limit2
        out = np.empty((3, len(z)))
        if loss == "soft_l1":
            root = np.sqrt(1.0 + z)
            out[0], out[1], out[2] = 2.0 * (root - 1.0), 1.0 / root, -0.5 / root**3
        else:
            near = z <= 1.0
            root = np.sqrt(np.where(near, 1.0, z))
            out[0] = np.where(near, z, 2.0 * root - 1.0)
            out[1] = np.where(near, 1.0, 1.0 / root)
            out[2] = np.where(near, 0.0, -0.5 / root**3)
        out[0, m:], out[1, m:], out[2, m:] = z[m:], 1.0, 0.0
        out[0] *= limit2
        out[2] /= limit2
        return out

    return rho


def robust_inflation(rows: Array, dof: float, loss: Loss, *, is_stated: bool) -> float:
    """Return the inflation of the points' independent variances under a robust loss.

    mean(psi^2) / mean(psi')^2 of the residuals (Huber, Robust Statistics, 1981, ch. 7).

    Args:
        rows: (m,) residuals over their independent errors.
        dof: degrees of freedom of the residuals.
        is_stated: errors are stated, not fitted; the factor of normal residuals is then a minimum.
    """
    if loss == "soft_l1":
        root = np.sqrt(1.0 + rows**2)
        psi, slope = rows / root, 1.0 / root**3
    else:
        psi = np.clip(rows, -HUBER_LIMIT, HUBER_LIMIT)
        slope = (np.abs(rows) <= HUBER_LIMIT).astype(float)
    ratio = float(np.sum(psi**2) / max(dof, 1.0) / max(float(np.mean(slope)), 1e-3) ** 2)
    return max(ratio, NORMAL_INFLATION[loss]) if is_stated else ratio
