"""The nodal kinematics: the reference that the solver is measured against."""
