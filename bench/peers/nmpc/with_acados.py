"""The problem of problem.py by acados: Gauss-Newton SQP with HPIPM, or one real-time iteration."""

import os
import sys
import time

import acados
import casadi as ca
import numpy as np

import problem as ocp
from problem import INPUTS, INTERVAL_S, INTERVALS, OBSTACLES, PARAMETERS, STATES

os.environ["ACADOS_SOURCE_DIR"] = acados.DIR
os.environ["TERA_PATH"] = acados.TERA_PATH
os.environ["ACADOS_PYTHON_INTERFACE_PATH"] = acados.TEMPLATE_DIR
sys.path.insert(0, os.path.dirname(acados.TEMPLATE_DIR))
from acados_template import AcadosModel, AcadosOcp, AcadosOcpSolver  # noqa: E402

# acados multiplies everything before the last point, slacks too, by the interval.
UNSCALED = 1.0 / INTERVAL_S
FAR = 1e6


def model(name):
    x, u = ca.SX.sym("x", STATES), ca.SX.sym("u", INPUTS)
    p, rate = ca.SX.sym("p", PARAMETERS), ca.SX.sym("rate", STATES)
    model = AcadosModel()
    model.name = name
    model.x, model.u, model.p, model.xdot = x, u, p, rate
    model.f_expl_expr = ocp.derivative(x, u)
    model.f_impl_expr = rate - model.f_expl_expr
    model.cost_y_expr = ocp.residuals(x, u, p)
    model.cost_y_expr_e = ocp.final_residuals(x, p)
    model.con_h_expr = model.con_h_expr_e = ocp.margins(x, p)
    return model


def set_cost(description):
    cost, model = description.cost, description.model
    stage, final = model.cost_y_expr.numel(), model.cost_y_expr_e.numel()
    cost.cost_type = cost.cost_type_e = "NONLINEAR_LS"
    # Half of what is weighted is counted.
    cost.W, cost.W_e = 2.0 * UNSCALED * np.eye(stage), 2.0 * np.eye(final)
    cost.yref, cost.yref_e = np.zeros(stage), np.zeros(final)
    linear, quadratic = ocp.LINEAR * np.ones(3 + OBSTACLES), 2.0 * ocp.QUADRATIC * np.ones(3 + OBSTACLES)
    cost.zl = cost.zu = UNSCALED * linear
    cost.Zl = cost.Zu = UNSCALED * quadratic
    cost.zl_e = cost.zu_e = linear
    cost.Zl_e = cost.Zu_e = quadratic


def set_constraints(constraints):
    constraints.x0 = np.zeros(STATES)
    constraints.idxbu = np.arange(INPUTS)
    constraints.lbu, constraints.ubu = -ocp.INPUT_MAX, ocp.INPUT_MAX
    constraints.idxbx = constraints.idxbx_e = np.array([3, 4, 5])
    constraints.lbx = constraints.lbx_e = -ocp.VELOCITY_MAX
    constraints.ubx = constraints.ubx_e = ocp.VELOCITY_MAX
    constraints.lh = constraints.lh_e = np.zeros(OBSTACLES)
    constraints.uh = constraints.uh_e = np.full(OBSTACLES, FAR)
    constraints.idxsbx = constraints.idxsbx_e = np.arange(3)
    constraints.idxsh = constraints.idxsh_e = np.arange(OBSTACLES)


class Acados:
    """`real_time` takes one iteration; otherwise up to `iterations` until the residuals are below `tolerance`."""

    def __init__(self, folder, real_time, tolerance=1e-3, iterations=30, blocks=5):
        name = "real_time" if real_time else "converged"
        description = AcadosOcp()
        description.acados_include_path = acados.INCLUDE_DIR
        description.acados_lib_path = acados.LIB_DIR
        description.model = model(name)
        description.dims.N = INTERVALS
        description.parameter_values = np.zeros(PARAMETERS)
        set_cost(description)
        set_constraints(description.constraints)
        options = description.solver_options
        options.tf = INTERVALS * INTERVAL_S
        options.nlp_solver_type = "SQP_RTI" if real_time else "SQP"
        options.nlp_solver_max_iter = iterations
        options.nlp_solver_tol_stat = options.nlp_solver_tol_eq = tolerance
        options.nlp_solver_tol_ineq = options.nlp_solver_tol_comp = tolerance
        options.qp_solver = "PARTIAL_CONDENSING_HPIPM"
        options.qp_solver_cond_N = blocks
        options.qp_solver_iter_max = 50
        options.qp_solver_warm_start = 1
        options.hpipm_mode = "SPEED"
        options.hessian_approx = "GAUSS_NEWTON"
        options.integrator_type = "ERK"
        options.sim_method_num_stages, options.sim_method_num_steps = 4, 1
        options.print_level = 0
        folder = os.path.join(folder, f"acados_{name}")
        os.makedirs(folder, exist_ok=True)
        description.code_export_directory = os.path.join(folder, "c")
        before = os.getcwd()
        os.chdir(folder)
        self.solver = AcadosOcpSolver(description, json_file=os.path.join(folder, "ocp.json"), verbose=False)
        os.chdir(before)
        self.warm = ocp.WarmStart()

    def solve(self, problem):
        solver = self.solver
        if problem.step == 0:
            solver.reset()
        states, inputs = self.warm.begin(problem)
        for k, parameters in enumerate(problem.parameters()):
            solver.set(k, "p", parameters)
            solver.set(k, "x", states[k])
            if k < INTERVALS:
                solver.set(k, "u", inputs[k])
        solver.set(0, "lbx", problem.state)
        solver.set(0, "ubx", problem.state)
        start = time.process_time()
        status = solver.solve()
        cpu_s = time.process_time() - start
        states = np.array([solver.get(k, "x") for k in range(INTERVALS + 1)])
        inputs = np.array([solver.get(k, "u") for k in range(INTERVALS)])
        self.warm.keep(states, inputs)
        return ocp.Solution(
            inputs,
            cpu_s,
            int(np.ravel(solver.get_stats("sqp_iter"))[0]),
            int(np.sum(solver.get_stats("qp_iter"))),
            status == 0,
            str(int(status)),
        )
