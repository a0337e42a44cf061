"""The robot over the Franka Control Interface: two processes of their own speak libfranka, one to the arm, one to
the hand."""
