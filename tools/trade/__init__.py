"""Speed against accuracy, measured: solvers and peers, fidelity, control rate."""
