"""Double-arc avoidance of stay cables (Xu, Yan, Zhao, Zhu, Li 2019), for a leg that is cut by a stay.

Between two places A1 and A2 of one height, d apart, stays come down. In the plane through A1A2 that is inclined like the
lowest stay, at theta_max, B1 and B2 lie d/2 below A1 and A2, straight down the plane. The text asks for the point where
two circles about them touch, and prints the radius d, with which they cross in two points; they touch with radius d/2,
at T, d below the middle... of which only d/2 counts, as both centres lie d/2 down and T another 0 beside: T is the
middle of B1B2. A1-T-A2 is smoothed by a B-spline.

T passes a stay through the middle of A1A2, inclined at theta_c, by `(d/2) sin(theta_max - theta_c)`: by nothing at all
if that is the lowest stay. The crossing of the larger circles lies further down, and a longer A1A2 puts T further
down too; where none of these keeps the clearance, there is no double arc.
"""
