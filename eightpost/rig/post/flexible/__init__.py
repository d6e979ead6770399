"""Flexible car of the virtual rig: engine on mounts, elastic chassis, friction that sticks, tires that stiffen."""

from eightpost.rig.post.flexible.car import FlexibleCar, base_car, flexible_truth

__all__ = ["FlexibleCar", "base_car", "flexible_truth"]
