"""Poses, polylines and the pinhole camera."""

from dlokit.geometry.polylines import arc_lengths as arc_lengths
from dlokit.geometry.polylines import resample as resample
from dlokit.geometry.polylines import rmse_m as rmse_m
from dlokit.geometry.polylines import segment_near as segment_near
from dlokit.geometry.polylines import tangents as tangents
from dlokit.geometry.poses import compose as compose
from dlokit.geometry.poses import downward as downward
from dlokit.geometry.poses import homogeneous as homogeneous
from dlokit.geometry.poses import inverse as inverse
from dlokit.geometry.poses import lifted as lifted
from dlokit.geometry.poses import matrix as matrix
from dlokit.geometry.poses import pose as pose
from dlokit.geometry.poses import pose_from_matrix as pose_from_matrix
from dlokit.geometry.poses import rigid_pose as rigid_pose
from dlokit.geometry.poses import rotation as rotation
from dlokit.geometry.poses import transform as transform
