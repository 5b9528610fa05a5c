"""RotorPy as the simulator of one's own of `haltere gap diagnose --import … --simulator`: the worked example of the protocol of
docs/INTERFACES.md, section 6.

    pip install --no-deps "rotorpy<2" && pip install numpy scipy
    haltere gap diagnose --import usdlog log07 --vehicle crazyflie-2.1 --reference log00 log01 log02 \\
        --simulator "python3 python/rotorpy_simulator.py"
"""

import json
import sys

import numpy as np
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.trajectories.hover_traj import HoverTraj
from rotorpy.vehicles.crazyflie_params import quad_params as crazyflie
from rotorpy.vehicles.multirotor import Multirotor

#: Integration and control step, s; the usual lag of the motors of a Crazyflie and how much their speed trembles, rad/s.
STEP_S = 0.01
TREMBLES = 5.0


def params(vehicle, mass, places, full_n):
    """The vehicle file in RotorPy's words: x forward, y left."""
    fastest = crazyflie["rotor_speed_max"]
    turns = [1.0 if motor["turns"] == "cw" else -1.0 for motor in vehicle["motor"]]
    k_eta = full_n / fastest**2
    inertia = dict(zip(("Ixx", "Iyy", "Izz"), vehicle["inertia_kgm2"]))
    rotors = {f"r{k + 1}": np.array([*place, 0.0]) for k, place in enumerate(places)}
    torque = k_eta * vehicle["thrust"]["torque_m"]
    return {**crazyflie, **inertia, "mass": mass, "rotor_pos": rotors, "rotor_directions": np.array(turns),
            "k_eta": k_eta, "k_m": torque, "rotor_speed_min": 0.0, "motor_noise_std": TREMBLES}


def fly(asked):
    vehicle, jitter, thrust = asked["vehicle"], asked["jitter"], asked["vehicle"]["thrust"]
    np.random.seed(asked["seed"])
    places = np.array([[motor["forward_m"], -motor["right_m"]] for motor in vehicle["motor"]])
    mass, strength, moment = vehicle["mass_kg"] * jitter["mass"], np.array(jitter["thrust"], dtype=float), np.zeros(2)
    for effect in asked["effects"]:
        motor = effect["motor"] - 1
        if effect["id"] == "weak_motor":
            strength[motor] *= 1.0 - effect["size"]
        elif effect["id"] == "load":
            mass += effect["size"]
            moment += effect["size"] * places[motor]
        else:
            raise ValueError(f"unknown effect {effect['id']}")
    # The controller knows the file; the plant has a load, whose weight moves the centre of mass, and weaker motors.
    known = params(vehicle, vehicle["mass_kg"], places, thrust["full_n"])
    plant = Multirotor(params(vehicle, mass, places - moment / mass, thrust["full_n"]))
    controller = SE3Control(known)
    hovering = np.sqrt(mass * 9.81 / 4 / plant.k_eta)
    state = {"x": np.array([0.0, 0.0, asked["height_m"]]), "v": np.zeros(3), "q": np.array([0.0, 0.0, 0.0, 1.0]),
             "w": np.zeros(3), "wind": np.zeros(3), "rotor_speeds": np.full(4, hovering)}
    trajectory = HoverTraj(x0=state["x"])
    every = max(1, round(1.0 / asked["rate_hz"] / STEP_S))
    rows = []
    for step in range(round(asked["duration_s"] / STEP_S)):
        t = step * STEP_S
        told = controller.update(t, state, trajectory.update(t))["cmd_motor_speeds"]
        told = np.clip(told, 0.0, plant.rotor_speed_max)
        state = plant.step(state, {"cmd_motor_speeds": told * np.sqrt(strength)}, STEP_S)
        if not np.isfinite(state["x"]).all() or abs(state["x"][2]) > 10.0:
            raise ValueError("it fell")
        if step % every == 0:
            # Commands as the log has them, by the law of the vehicle file: thrust = full · command ^ exponent.
            commands = (told / plant.rotor_speed_max) ** (2.0 / thrust["command_exponent"])
            speed = float(np.hypot(*state["v"][:2]))
            rows.append([t, *map(float, commands), float(state["x"][2]), speed, thrust["nominal_v"]])
    return rows


COLUMNS = ["t_s", "m1", "m2", "m3", "m4", "height_m", "speed_mps", "supply_v"]

for line in sys.stdin:
    request = json.loads(line)
    try:
        answer = {"columns": COLUMNS, "rows": fly(request)}
    except Exception as why:  # Whatever happens, the next flight is answered.
        answer = {"error": f"{type(why).__name__}: {why}"}
    print(json.dumps({"flight": request["flight"], **answer}), flush=True)
