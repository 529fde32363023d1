"""What the actions say of the DLO: its stiffness, friction and set, from the shapes before and after them."""
