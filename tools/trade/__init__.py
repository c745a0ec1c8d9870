"""Speed against accuracy, measured: solvers and peers, stops, parts, control rates, builds, extreme cases."""
