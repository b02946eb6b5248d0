"""A flight controller in place of `fcu`: python cascade.py INSTANCE AIRFRAME.toml."""

import socket
import sys
import tomllib
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

instance, tables = int(sys.argv[1]), tomllib.loads(Path(sys.argv[2]).read_text())
rotors, body = tables["rotors"], tables["vehicle"]
m, J = np.mean(body["mass_kg"]), np.mean(body["inertia_kg_m2"], axis=1)
angle, arm = np.radians(rotors.get("angle_deg", [])), rotors.get("radius_m", 0.0)
places = rotors.get("position_m") or arm * np.transpose([np.cos(angle), np.sin(angle)])
forward, left = np.transpose([place[:2] for place in places])
yaw = rotors["torque_to_thrust_m"] * np.array(rotors["spin"])
mix = np.linalg.pinv([np.ones(len(yaw)), left, forward, yaw])  # thrust and torque to newtons
full_N = np.multiply(rotors["thrust_coefficient"], np.square(rotors["full_speed_rad_s"]))

setpoints, plant = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
setpoints.bind(("127.0.0.1", 14580 + instance))
setpoints.setblocking(False)
plant.bind(("127.0.0.1", 4660 + instance))  # the last thing: from now on states are sent
mav = mavlink.MAVLink(None, srcSystem=instance + 1, srcComponent=1)
goal = mavlink.MAVLink_set_position_target_local_ned_message(*[0] * 16)  # until one comes
while True:
    datagram, simulator = plant.recvfrom(4096)
    state = mav.parse_buffer(datagram)[0]
    if state.get_type() == "HEARTBEAT":  # simulation time stands: there is nothing to answer
        continue
    try:
        while True:  # the last setpoint that was sent before this state
            goal = mav.parse_buffer(setpoints.recv(4096))[0]
    except BlockingIOError:
        pass
    R = Rotation.from_quat(state.q, scalar_first=True)  # body Forward-Right-Down to North-East-Down
    away = np.subtract([goal.x, goal.y, goal.z], [state.x, state.y, state.z])
    slow = np.subtract([goal.vx, goal.vy, goal.vz], R.apply([state.vx, state.vy, state.vz]))
    a = np.clip(1.5 * away + 2.2 * slow, -4.0, 4.0) + np.array([goal.afx, goal.afy, goal.afz])
    force = m * (a - [0.0, 0.0, 9.81])  # of the rotors, N
    down = -force / np.linalg.norm(force)  # where the body's third axis is to point
    right = np.cross(down, [np.cos(goal.yaw), np.sin(goal.yaw), 0.0])
    right /= np.linalg.norm(right)
    wanted = Rotation.from_matrix(np.transpose([np.cross(right, down), right, down]))
    turn = (R.inv() * wanted).as_rotvec()  # from the attitude to the wanted one, body axes
    rate = np.array([state.rollspeed, state.pitchspeed, state.yawspeed])
    thrust = -force @ R.apply([0.0, 0.0, 1.0])
    torque = J * ([40.0, 40.0, 6.0] * turn - [11.0, 11.0, 5.0] * rate)
    u = np.sqrt(np.clip(mix @ [thrust, *torque] / full_N, 0.0, 1.0))
    answer = mav.hil_actuator_controls_encode(state.time_usec, [*u, *[0.0] * (16 - len(u))], 129, 1)
    plant.sendto(answer.pack(mav), simulator)
