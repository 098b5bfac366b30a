// Gruen's linearized equations of a patch: design matrix, normal matrix, their solution.
#pragma once
#include <vector>

#include "array.hpp"

namespace bodytrack::patches {

// Two shifts, four of the affinity, gain and offset of the grey values (Gruen 1985).
constexpr int N_PARAMETERS = 8;

// Positions of the four affine terms; 0 and 3 are the shifts, 6 and 7 brightness and contrast.
constexpr int AFFINE[4] = {1, 2, 4, 5};

struct Rule {
    Index half, most_iterations;
    // what is left to go at the end, and how far a match may move, px
    double tolerance, farthest;
    // weight of the affine terms' start
    double prior;
    // Gruen's form, which linearizes the search image, not the template
    bool classical;

    Index n_pixels() const { return (2 * half + 1) * (2 * half + 1); }
};

// Powers that white noise keeps in residuals and in gradients; taps of the smoothing that the images went through.
struct Noise {
    double residual_gain, gradient_gain;
    Array<const float, 1> taps;
};

using Vector = double[N_PARAMETERS];
using Matrix = double[N_PARAMETERS][N_PARAMETERS];

// What a match writes to on its way; patches of up to the half size that it is made for.
struct Workspace {
    Workspace(Index half, Index n_taps);

    // columns of the design matrix; grey values of the template, of the search patch, and their difference
    std::vector<float> design[N_PARAMETERS], fixed, grey, residual;
    Matrix normal, factor;
    // influences of the residuals on both shifts, and scratch
    std::vector<float> influences[2], passed;
};

// Mean and standard deviation of grey values.
struct Moments {
    float mean, deviation;
};

float dot(const float *a, const float *b, Index n);

Moments moments(const float *values, Index n);

// Cholesky factor of a matrix; false where a parameter cannot be determined. That is where a pivot loses five digits,
// or where gradients are below a thousandth of a grey level per pixel.
bool factorize(const Matrix &matrix, Matrix &factor);

// Solves in place with the factor of the matrix.
void solve(const Matrix &factor, Vector &right);

// Columns of Gruen's design matrix from gradients in columns 0 and 3; lengths in halves of the patch. Order: shift x,
// its growth along x and y, shift y, its growth along x and y, brightness, contrast.
void complete_design(Workspace &work, const float *grey, Moments of, double gain, Index half);

// J^T J, with the prior's weight on the four affine terms.
void fill_normal(Workspace &work, Index n, double prior);

// Search patch, radiometrically adjusted, minus template.
void fill_residuals(Workspace &work, double brightness, double contrast, Index n);

}  // namespace bodytrack::patches
