// Columns of packed rows that Python makes or reads; tracker/kernels/rows/ says what they are, and their units.
#pragma once

namespace bodytrack::rows {

namespace camera {
enum Column {
    R11, R12, R13, TX, R21, R22, R23, TY, R31, R32, R33, TZ,
    CENTRE_X, CENTRE_Y, CENTRE_Z, FX, FY, CX, CY, K1, K2, P1, P2, K3, SHEAR, K4, K5, K6, REACH2,
    N_COLUMNS
};
}

namespace bundle_camera {
enum Column {
    R11, R12, R13, R21, R22, R23, R31, R32, R33, X, Y, Z, C, CX, CY, AFFINITY, SHEAR,
    K1, K2, P1, P2, K3, K4, K5, K6, DELAY,
    N_COLUMNS
};
}

namespace bundle_unknown {
enum Column { TURN_X, TURN_Y, TURN_Z, X, Y, Z, C, CX, CY, AFFINITY, SHEAR, K1, K2, P1, P2, K3, DELAY, N_UNKNOWNS };
}

namespace superquadric {
enum Column { A1, A2, A3, E1, E2, K1, K2, N_COLUMNS };
}

namespace sample {
enum Column { U, V, NU, NV, LENGTH, X, Y, Z, PART, BETWEEN, NX, NY, NZ, N_COLUMNS };
}

namespace scene_point {
enum Column { X, Y, DX, DY, WEIGHT, N_COLUMNS };
}

namespace region {
enum Column { START, LEFT, TOP, WIDTH, HEIGHT, N_COLUMNS };
}

namespace met_place {
enum Column { X, NORMAL_X = 3, RAY_X = 6, FACING = 9, N_COLUMNS };
}

namespace carried_place {
enum Column { U, W, VARIANCE, FACING, U_X, U_Y, U_Z, W_X, W_Y, W_Z, N_COLUMNS };
}

}  // namespace bodytrack::rows
