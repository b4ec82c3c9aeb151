"""Physical effects that the base model lacks, one file each, registered by name."""

from mjx_cutting.cutting.effects.abstract import STAGES, AbstractEffect, EdgeForce, Parameter
from mjx_cutting.cutting.effects.broken_tooth import BrokenTooth
from mjx_cutting.cutting.effects.clamp_mode import ClampMode
from mjx_cutting.cutting.effects.clogging import Clogging
from mjx_cutting.cutting.effects.command_stair import CommandStair
from mjx_cutting.cutting.effects.crosstalk import Crosstalk
from mjx_cutting.cutting.effects.entry_exit import EntryExit
from mjx_cutting.cutting.effects.flank_wear import FlankWear
from mjx_cutting.cutting.effects.helix_lag import HelixLag
from mjx_cutting.cutting.effects.hysteresis import Hysteresis
from mjx_cutting.cutting.effects.joint_friction import JointFriction
from mjx_cutting.cutting.effects.layered_material import LayeredMaterial
from mjx_cutting.cutting.effects.mains_pickup import MainsPickup
from mjx_cutting.cutting.effects.material_periodicity import MaterialPeriodicity
from mjx_cutting.cutting.effects.ploughing import Ploughing
from mjx_cutting.cutting.effects.process_damping import ProcessDamping
from mjx_cutting.cutting.effects.radial_runout import RadialRunout
from mjx_cutting.cutting.effects.regenerative_chatter import RegenerativeChatter
from mjx_cutting.cutting.effects.registry import effect_class, effect_names, register
from mjx_cutting.cutting.effects.robot_mode import RobotMode
from mjx_cutting.cutting.effects.sensor_lowpass import SensorLowpass
from mjx_cutting.cutting.effects.sensor_resonance import SensorResonance
from mjx_cutting.cutting.effects.side_friction import SideFriction
from mjx_cutting.cutting.effects.size_effect import SizeEffect
from mjx_cutting.cutting.effects.spindle_droop import SpindleDroop
from mjx_cutting.cutting.effects.static_compliance import StaticCompliance
from mjx_cutting.cutting.effects.thermal_drift import ThermalDrift
from mjx_cutting.cutting.effects.time_offset import TimeOffset
from mjx_cutting.cutting.effects.tool_gravity import ToolGravity
from mjx_cutting.cutting.effects.tooth_path import ToothPath
from mjx_cutting.cutting.effects.torque_ripple import TorqueRipple
from mjx_cutting.cutting.effects.unbalance import Unbalance
from mjx_cutting.cutting.effects.unequal_pitch import UnequalPitch
from mjx_cutting.cutting.effects.unnamed_arc import UnnamedArc
from mjx_cutting.cutting.effects.unnamed_gain import UnnamedGain

__all__ = [
    "STAGES",
    "AbstractEffect",
    "EdgeForce",
    "Parameter",
    "BrokenTooth",
    "ClampMode",
    "Clogging",
    "CommandStair",
    "Crosstalk",
    "EntryExit",
    "FlankWear",
    "HelixLag",
    "Hysteresis",
    "JointFriction",
    "LayeredMaterial",
    "MainsPickup",
    "MaterialPeriodicity",
    "Ploughing",
    "ProcessDamping",
    "RadialRunout",
    "RegenerativeChatter",
    "RobotMode",
    "SensorLowpass",
    "SensorResonance",
    "SideFriction",
    "SizeEffect",
    "SpindleDroop",
    "StaticCompliance",
    "ThermalDrift",
    "TimeOffset",
    "ToolGravity",
    "ToothPath",
    "TorqueRipple",
    "Unbalance",
    "UnequalPitch",
    "UnnamedArc",
    "UnnamedGain",
    "effect_class",
    "effect_names",
    "register",
]
