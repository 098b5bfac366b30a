// A refinement in one go: Gauss-Newton steps of a pose on contours, colours and followed places, inside joint limits.
//
// The twin is `TwistIcpEstimation` with the equations that each kind of evidence makes in Python (`Evidence.equations`).
#pragma once
#include <functional>
#include <optional>
#include <vector>

#include "body/anchors.hpp"
#include "body/kinematics.hpp"
#include "contours/oriented_matching.hpp"
#include "contours/tracing.hpp"
#include "regions/shifts.hpp"

namespace bodytrack::descent {

// The model whose pose is sought: (P, 4, 4) where its parts are in the reference pose, (P,) the last parameter that moves
// each; (dof, dof + 1) moves from `BodyModel.moves`; (dof, 2) limits.
struct Model {
    body::Chain chain;
    Array<const double, 3> model_from_parts;
    Array<const Index, 1> part_parameters;
    Array<const bool, 2> moves;
    Array<const double, 2> limits;
};

// The scene it is in: all parts, as `trace_contours` takes them; the person's own begin at first_part.
struct Stage {
    // (P, 4, 4) world_from_part; those of the person are replaced
    Array<const double, 3> placements;
    Index first_part;
    contours::Grids grids;
    contours::Parts parts;
    contours::Views views;
    contours::Spacing spacing;
    // (V, P) parts whose contours count for nothing in a view
    Array<const bool, 2> hidden;
};

// What a kind of evidence counts in the sum of all; more where it leaves less than exact_px over, RMS (0: never). One that
// is apart is added as it is.
struct Counted {
    double weight, exact_px;
    bool apart = false;
};

// Scene points (S, 5) of all views, see `match_oriented`; least cosine of a pair; length that is one observation.
struct Edges {
    Counted counted;
    Array<const float, 2> scene;
    Array<const Index, 1> first;
    double cosine, px_per_observation;
};

// Colours beside the contours, see `find_shifts`; the parts as `parts_beside` takes them.
struct Colours {
    Counted counted;
    regions::Lines lines;
    contours::Parts parts;
    double px_per_observation;
};

// Followed places, and what each counts (N,); see `residuals_of`. What faces the camera by less than a cosine is not seen.
struct Places {
    Counted counted;
    body::Carried carried;
    Array<const double, 1> shares;
    double slide_m, reach_px, least_facing;
};

// Where a kind that is asked writes its equations: J^T W J (dof, dof), J^T W r (dof,), sums of w r^2 and of w.
struct Answer {
    Array<double, 2> matrix;
    Array<double, 1> vector;
    body::Sums *sums;
};

// Kinds that are asked, in Python, at the pose that the steps have come to.
struct Others {
    std::vector<Counted> counted;
    std::function<void(double gate_px, const std::vector<Answer> &answers)> ask;
};

struct Kinds {
    std::optional<Edges> edges;
    std::optional<Colours> colours;
    std::optional<Places> places;
    // largest weight of a kind that says nothing in this frame
    double most_silent;
    Others others;
};

// How a pose is held and when it is at rest, (dof,) each: the start, and what holds it there; where it usually is, and
// inverse squares of how far from there, times what such a pull counts, px; least steps.
struct Rule {
    Array<const double, 1> start, prior, usual, inverse_spreads2;
    double rare_px;
    Array<const double, 1> resting;
};

// The last step's equations: sums of w r^2 and of w, and the number of steps.
struct Reached {
    double squares = 0.0, total = 0.0;
    Index n_steps = 0;
};

// Steps from a pose q (dof,) with a gate (G,) each, px; at rest with a wide gate, only the narrowest is left. Writes the
// pose reached, and the equations of the last step before `prior`: J^T W J (dof, dof), J^T W r (dof,).
// Throws std::domain_error where the equations are not positive definite.
Reached descend(const Model &model, const Stage &stage, const Kinds &kinds, const Rule &rule, Array<const double, 1> gates,
                Array<double, 1> q, Array<double, 2> matrix, Array<double, 1> vector);

}  // namespace bodytrack::descent
