"""In which order places are visited: solvers, metrics and lower bounds."""
