"""Numbers of the dual projection, of arrays and of tensors."""

STEP = 1.25  # length of a dual step, 1 being Chambolle's; primal-dual methods of fixed weights converge below 4/3
NOTHING = 1e-12  # a weight that changes no digit of values about 1, and whose inverse would overflow further down
ALL = 1e6  # a weight that leaves nothing of values about 1; with more the steps would be too small for fixed point
