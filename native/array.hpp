// Arrays as kernels see them: rows one after the other, like a C-contiguous array of numpy; nothing is owned.
#pragma once
#include <cstdint>

namespace bodytrack {

using Index = std::int64_t;

// Grey level of a pixel, or a mark.
using Byte = std::uint8_t;

template <class T, int N>
struct Array {
    T *data = nullptr;
    Index shape[N] = {};

    // The array at one place of the first axis.
    Array<T, N - 1> operator[](Index i) const {
        Array<T, N - 1> inner;
        Index step = 1;
        for (int k = 1; k < N; k++) {
            inner.shape[k - 1] = shape[k];
            step *= shape[k];
        }
        inner.data = data + i * step;
        return inner;
    }

    // One number.
    template <class... Places>
    T &operator()(Places... places) const {
        static_assert(sizeof...(Places) == N, "one place for each axis");
        const Index at[N] = {static_cast<Index>(places)...};
        Index offset = at[0];
        for (int k = 1; k < N; k++) offset = offset * shape[k] + at[k];
        return data[offset];
    }

    Index size() const {
        Index product = 1;
        for (int k = 0; k < N; k++) product *= shape[k];
        return product;
    }

    // What takes an array to read takes one to write as well.
    operator Array<const T, N>() const {
        Array<const T, N> same;
        same.data = data;
        for (int k = 0; k < N; k++) same.shape[k] = shape[k];
        return same;
    }
};

template <class T>
struct Array<T, 1> {
    T *data = nullptr;
    Index shape[1] = {};

    T &operator[](Index i) const { return data[i]; }
    T &operator()(Index i) const { return data[i]; }
    Index size() const { return shape[0]; }
    operator Array<const T, 1>() const { return {data, {shape[0]}}; }
};

}  // namespace bodytrack
