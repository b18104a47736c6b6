"""PX4's events that matter before and during a mission, in our words: what it is, what to do.

Names and arguments are those of PX4 1.17's source (`events::ID("...")`); each line is
words, or (words, argument layout) with the letters of `struct` and, for enumerations, m navigation
mode, a failsafe action, c failsafe cause. Layouts of checks leave out their common head.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

MODES: Final = MappingProxyType(
    {
        0: "Manual",
        1: "Altitude",
        2: "Position",
        3: "Mission",
        4: "Hold",
        5: "Return",
        6: "Acro",
        7: "Offboard",
        8: "Stabilized",
        10: "Takeoff",
        11: "Land",
        14: "Orbit",
    }
)
ACTIONS: Final = MappingProxyType(
    {
        1: "a warning",
        2: "Position mode",
        3: "Altitude mode",
        4: "Stabilized mode",
        5: "Hold",
        6: "Return",
        7: "Land",
        8: "a blind descent",
        9: "disarming",
        10: "termination",
    }
)
CAUSES: Final = MappingProxyType(
    {
        1: "manual control lost",
        2: "ground station lost",
        3: "battery low",
        4: "battery critical",
        5: "battery at emergency level",
        6: "flight time running out",
    }
)

_Words = Mapping[str, str | tuple[str, str]]

_CALIBRATE = "calibrate it in the ground station"
_OPEN_SKY = "wait, with a free view of the sky"
_RESTART = "restart the autopilot standing still"

_CHECKS: _Words = {
    "check_accel_missing": ("accelerometer {0} is missing", "B"),
    "check_accel_no_data": ("accelerometer {0} gives no data; restart the autopilot", "B"),
    "check_accel_not_calibrated": (f"accelerometer {{0}} is not calibrated; {_CALIBRATE}", "B"),
    "check_gyro_missing": ("gyroscope {0} is missing", "B"),
    "check_gyro_no_data": ("gyroscope {0} gives no data; restart the autopilot", "B"),
    "check_gyro_not_calibrated": (f"gyroscope {{0}} is not calibrated; {_CALIBRATE}", "B"),
    "check_imu_accel_inconsistent": ("accelerometer {0} disagrees; let it warm up", "B"),
    "check_imu_gyro_inconsistent": ("gyroscope {0} disagrees; let it warm up", "B"),
    "check_mag_missing": ("compass {0} is missing", "B"),
    "check_mag_no_data": ("compass {0} gives no data", "B"),
    "check_mag_not_calibrated": (f"compass {{0}} is not calibrated; {_CALIBRATE}", "B"),
    "check_mag_fault": ("compass {0} disturbs the estimator; move away from metal", "B"),
    "check_mag_consistency": ("compasses differ by {0} degrees; move away from metal", "h"),
    "check_mag_sys_has_mag_missing": ("{0} compass found where {1} are required", "BB"),
    "check_baro_missing": ("barometer {0} is missing", "B"),
    "check_baro_no_data": ("barometer {0} gives no data", "B"),
    "check_distance_sensor_missing": ("distance sensor {0} is missing", "B"),
    "check_distance_sensor_invalid": ("distance sensor {0} gives no data", "B"),
    "check_optical_sensor_missing": "the optical flow sensor is missing",
    "check_optical_flow_sensor_invalid": "the optical flow sensor gives no data",
    "check_battery_critical": "the battery is critically low; charge or swap it",
    "check_battery_emergency": "the battery is empty; charge or swap it",
    "check_battery_low": "the battery is low; charge or swap it",
    "check_battery_disconnected": ("battery {0} is disconnected", "B"),
    "check_battery_missing": ("battery {0} is missing", "B"),
    "check_battery_fault": ("battery {0} reports a fault", "B"),
    "check_battery_unhealthy": "the battery is unhealthy",
    "check_battery_rem_flight_time_low": "the battery's flight time is running out",
    "check_estimator_missing_data": f"the estimator has not begun; {_RESTART}",
    "check_estimator_hgt_not_stable": "the height estimate wanders; wait",
    "check_estimator_heading_not_stable": "the heading estimate wanders; wait",
    "check_estimator_hor_pos_not_stable": "the position estimate wanders; wait",
    "check_estimator_hor_vel_not_stable": "the velocity estimate wanders; wait",
    "check_estimator_vert_vel_not_stable": "the climb estimate wanders; wait",
    "check_estimator_high_accel_bias": "the accelerometer's offset is high; calibrate it",
    "check_estimator_high_gyro_bias": f"the gyroscope's offset is high; {_RESTART}",
    "check_estimator_low_position_accuracy": f"the position is inaccurate; {_OPEN_SKY}",
    "check_estimator_position_failure_imminent": "the position is about to be lost",
    "check_estimator_mag_interference": "strong magnetic disturbance; move away from metal",
    "check_estimator_mag_fault": "the compass is not used any more",
    "check_estimator_gnss_fault": "the GPS heading is unreliable",
    "check_estimator_gnss_fusion_started": "GPS is used",
    "check_estimator_gnss_fusion_stopped": f"GPS is not used any more; {_OPEN_SKY}",
    "check_estimator_gnss_warning_spoofing": "the GPS signal looks forged",
    "check_estimator_gps_fix_too_low": f"no GPS fix; {_OPEN_SKY}",
    "check_estimator_gps_generic": f"poor GPS; {_OPEN_SKY}",
    "check_estimator_gps_not_fusing": f"the estimator does not use GPS yet; {_OPEN_SKY}",
    "check_estimator_gps_num_sats_too_low": f"too few GPS satellites; {_OPEN_SKY}",
    "check_estimator_gps_pdop_too_high": f"GPS satellites stand badly; {_OPEN_SKY}",
    "check_estimator_gps_hor_pos_err_too_high": f"GPS position inaccurate; {_OPEN_SKY}",
    "check_estimator_gps_vert_pos_err_too_high": f"GPS altitude inaccurate; {_OPEN_SKY}",
    "check_estimator_gps_speed_acc_too_low": f"GPS speed inaccurate; {_OPEN_SKY}",
    "check_estimator_gps_hor_pos_drift_too_high": f"the GPS position drifts; {_OPEN_SKY}",
    "check_estimator_gps_vert_pos_drift_too_high": f"the GPS altitude drifts; {_OPEN_SKY}",
    "check_estimator_gps_hor_speed_drift_too_high": f"the GPS speed drifts; {_OPEN_SKY}",
    "check_estimator_gps_vert_speed_drift_too_high": f"the GPS climb drifts; {_OPEN_SKY}",
    "check_estimator_gps_jamming_critical": "the GPS signal is jammed",
    "check_estimator_gps_spoofed": "the GPS signal is forged",
    "check_failure_detector_roll": "it leans over too far; stand it level",
    "check_failure_detector_pitch": "it leans over too far; stand it level",
    "check_failure_detector_alt": "it lost altitude without command",
    "check_failure_detector_ext": "an external system reports a failure",
    "check_failure_detector_arm_esc": "a motor controller failed",
    "check_failure_detector_motor": "a motor failed",
    "check_failure_detector_imbalanced_prop": "a propeller is out of balance; swap it",
    "check_escs_telem_missing": "the motor controllers are not heard",
    "check_escs_offline": ("motor controller {0} is offline", "B"),
    "check_escs_fault": ("motor controller {0} reports a fault", "B"),
    "check_flight_time_limit": "the longest flight time is over",
    "check_gf_no_home": "the fence needs a home position; wait for GPS",
    "check_gf_violation_custom_gf": "it is outside the fence, or in a no-fly zone",
    "check_gf_violation_max_alt": "it is above GF_MAX_VER_DIST",
    "check_gf_violation_max_hor_dist": "it is farther from home than GF_MAX_HOR_DIST",
    "check_man_control_kill_engaged": "the kill switch is on; switch it off",
    "check_man_control_landing_gear_up": "the landing gear switch says up",
    "check_man_control_rtl_engaged": "the return switch is on; switch it off",
    "check_mission_failure": "PX4 finds that the mission cannot be completed",
    "check_modes_angular_velocity": "no angular velocity estimate; restart the autopilot",
    "check_modes_attitude": "no attitude estimate; keep it still",
    "check_modes_cannot_takeoff": "this mode cannot take off; choose Hold or Mission",
    "check_modes_global_pos": f"no position on the globe yet; {_OPEN_SKY}",
    "check_modes_home_position": f"no home position yet; {_OPEN_SKY}",
    "check_modes_local_alt": "no altitude estimate yet; wait",
    "check_modes_local_pos": f"no position estimate yet; {_OPEN_SKY}",
    "check_modes_manual_control": "no remote control is heard",
    "check_modes_mission": "no mission on board that can be flown",
    "check_modes_offboard_signal": "nothing commands Offboard mode; choose another",
    "check_navigator_failure_hagl": "a waypoint is above the greatest height",
    "check_open_drone_id_missing": "Remote ID is missing",
    "check_open_drone_id_unhealthy": "Remote ID is not ready",
    "check_parachute_missing": "the parachute is missing",
    "check_parachute_unhealthy": "the parachute is not ready",
    "check_avionics_power_high": ("the autopilot's supply is too high: {0:.2f} V", "f"),
    "check_avionics_power_low": ("the autopilot's supply is too low: {0:.2f} V", "f"),
    "check_avionics_power_missing": "the power module is not connected",
    "check_avionics_power_redundancy": "a second power supply is missing",
    "check_missing_system_power": "the supply voltage is not known",
    "check_power_oc_hipower": "too much current at the 5 V supply",
    "check_power_oc_periph": "too much current at the peripherals' 5 V supply",
    "check_cpuload_too_high": ("the autopilot's processor is busy to {0:.0f} %", "f"),
    "check_missing_cpuload": "the autopilot does not say how busy it is",
    "check_ram_usage_too_high": ("the autopilot's memory is full to {0:.0f} %", "f"),
    "check_rc_dl_no_dllink": "no ground station is connected (NAV_DLL_ACT wants one)",
    "check_missing_fmu_sdcard": "no SD card in the autopilot",
    "check_hardfault_present": "a crash dump is on the autopilot's SD card",
    "check_armable_configuration": "the vehicle is in its safety configuration",
    "check_system_arm_auth_failed": "arming was not authorised",
    "check_system_flight_term_active": "flight termination is active; restart",
    "check_system_no_global_pos": f"no position on the globe yet; {_OPEN_SKY}",
    "check_system_no_home_pos": f"no home position yet; {_OPEN_SKY}",
    "check_system_safety_button": "press the safety button",
    "check_system_usb_connected": "USB is plugged in; unplug it",
    "check_wind_too_high": "the wind is above the limit",
    "check_above_wind_limits_warning": "the wind is above the limit",
    "check_high_wind_warning": "strong wind",
}

_MISSION: _Words = {
    "navigator_mis_geofence_violation": (
        "plan item {0} lies in a no-fly zone, outside the fence, or beyond GF_MAX_HOR/VER_DIST",
        "h",
    ),
    "navigator_mis_geofence_no_home": "the fence needs a home position; wait for GPS",
    "navigator_mis_geofence_no_home2": "the fence needs a home position; wait for GPS",
    "navigator_mis_no_home_rel_alt": (
        "plan item {0} is above home, and there is no home yet; wait for GPS",
        "h",
    ),
    "navigator_mis_no_pos_lock": f"no position yet; {_OPEN_SKY}",
    "navigator_mis_first_wp_far": (
        "the first waypoint is {0} m from home (MIS_DIST_1WP); is it this place's mission?",
        "I",
    ),
    "navigator_mis_takeoff_missing": "it wants a take-off item (MIS_TKO_LAND_REQ)",
    "navigator_mis_land_missing": (
        "it wants a landing item, which we do not upload; set MIS_TKO_LAND_REQ to 0"
    ),
    "navigator_mis_takeoff_or_land_missing": (
        "it wants take-off and landing items; set MIS_TKO_LAND_REQ to 0"
    ),
    "navigator_mis_add_land_or_rm_to": (
        "it wants a landing item beside the take-off; set MIS_TKO_LAND_REQ to 0"
    ),
    "navigator_mis_add_to_or_rm_land": "it wants a take-off item beside the landing",
    "feasibility_mis_in_air_landing_req": (
        "it wants a landing item, which we do not upload; set MIS_TKO_LAND_REQ to 0"
    ),
    "navigator_mis_takeoff_not_first": "the take-off is not the first item with a place",
    "navigator_mis_takeoff_too_low": ("the take-off altitude is too low, at least {0:.1f} m", "f"),
    "navigator_mis_starts_w_landing": "it begins with a landing",
    "navigator_mis_starts_w_landing2": "it begins with a landing",
    "navigator_mis_unsup_cmd": ("plan item {0} is a command that it does not know: {1}", "HH"),
    "navigator_mis_vtol_items": "it has items for VTOL vehicles only",
    "navigator_mis_wp_gate_too_close": "a waypoint and a gate are too close",
    "navigator_geofence_invalid_against_home": (
        "the fence does not contain home: PX4 ignores all of it"
    ),
    "navigator_geofence_invalid_against_cur_pos": (
        "the fence does not contain the place where the vehicle stands"
    ),
    "mavlink_mission_ignore_mis_count": "another transfer of a plan is under way",
    "mavlink_mission_op_timeout": "the transfer of the plan took too long",
    "mavlink_mission_mis_item_invalid": "a plan item is not valid",
    "mavlink_mission_wp_index_exceeds_list": ("the plan has more items than the {0} stored", "H"),
    "mavlink_mission_storage_failure": "the plan cannot be stored",
    "mavlink_mission_storage_read_failure": "the stored plan cannot be read",
    "mavlink_mission_storage_write_failure2": "the plan cannot be stored",
    "mavlink_mission_storage_write_failure3": "the plan cannot be stored",
    "mavlink_mission_state_busy": "a ground station downloads the plan: the jump was dropped",
    "mavlink_mission_seq_out_of_bounds": "the plan on board has no such item",
    "mission_failed_to_read_wp": ("plan item {0} cannot be read", "H"),
    "mission_not_valid_loiter": "no mission that can be flown: it hovers",
    "mission_not_valid_refuse": "no mission that can be flown: it does not take off",
    "mission_finished_loiter": "the mission's items are over: it hovers",
}

_COMMANDER: _Words = {
    "commander_arm_denied_calibrating": "arming denied: a calibration runs",
    "commander_arm_denied_not_manual": "arming denied: in this mode only by hand",
    "commander_arm_denied_resolve_failures": "arming denied: health checks fail",
    "commander_arm_denied_throttle_center": "arming denied: throttle stick above centre",
    "commander_arm_denied_throttle_high": "arming denied: throttle stick not down",
    "commander_disarm_denied_not_landed": "disarming denied: not landed",
    "commander_mission_start_denied_no_mission": "no mission on board that can be flown",
    "commander_modeswitch_not_avail": ("{1} mode is not available now", "Im"),
    "commander_unsupported_auto_mode": "no such flight mode",
    "commander_gcs_lost": "ground station lost",
    "commander_dl_regained": "ground station heard again",
    "commander_rc_lost": "remote control lost",
    "commander_rc_override": "the pilot took over with the sticks",
    "failsafe_rc_override": "the pilot took over",
    "commander_mission_comp_lost": "PX4 lost its companion computer (us)",
    "commander_low_bat_shutdown": "the battery is empty: PX4 shuts down",
    "commander_failsafe_enter": ("failsafe: {2}, switching to {1}", "Iac"),
    "commander_failsafe_enter_hold": ("failsafe: {3}, {1} in {2} s", "IaHc"),
    "commander_failsafe_enter_generic": ("failsafe: switching to {1}", "Ia"),
    "commander_failsafe_enter_generic_hold": ("failsafe: {1} in {2} s", "IaH"),
    "commander_failsafe_enter_generic_warn": "failsafe warning",
    "commander_failsafe_enter_warn": ("failsafe warning: {1}", "Ic"),
    "commander_failsafe_enter_low_bat": "the battery is low: come home",
    "commander_failsafe_enter_crit_bat_warn": "the battery is critical: land now",
    "commander_failsafe_enter_crit_low_bat_warn": "the battery is empty: land at once",
    "commander_failsafe_enter_low_flight_time_warn": "flight time is running out",
    "navigator_reposition_outside_geofence": (
        "the point to fly to is outside the fence or in a no-fly zone"
    ),
    "navigator_mission_failure_heading": "it cannot turn to the heading of the item",
}

WORDS: Final[_Words] = MappingProxyType({**_CHECKS, **_MISSION, **_COMMANDER})
