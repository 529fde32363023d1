"""Mechanics of rods: elastic, chain, tracking and planning rod, rollouts, equilibrium, belief, posterior. Pure."""
