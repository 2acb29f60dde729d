"""How a multirotor flies a curve, and the power that it takes."""
