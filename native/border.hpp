// The border to Python: an argument is taken if it is an array of the right numbers and shape, else refused by name
// (TypeError: other numbers or no array; ValueError: shape, read-only). Behind the border nothing is checked.
#pragma once
#include <nanobind/nanobind.h>

#include <array>
#include <memory>
#include <string>
#include <type_traits>

#include "array.hpp"

namespace bodytrack {

namespace nb = nanobind;

// Any length of an axis.
constexpr Index ANY = -1;

// The name of an argument that is an array; also None gets to `Argument`, which refuses it by that name.
inline auto named(const char *name) { return nb::arg(name).none(); }

// One entry of a tuple of n, as the named tuples of `tracker.kernels` are.
inline nb::handle entry(const nb::tuple &given, int i, int n, const char *name) {
    if (int(nb::len(given)) != n)
        throw nb::value_error((std::string(name) + ": expected a tuple of " + std::to_string(n)).c_str());
    return PyTuple_GetItem(given.ptr(), i);
}

// Runs a kernel without the interpreter's lock.
template <class Kernel>
auto unlocked(Kernel kernel) {
    nb::gil_scoped_release release;
    return kernel();
}

namespace border {

template <class T>
constexpr const char *name_of() {
    using N = std::remove_const_t<T>;
    if constexpr (std::is_same_v<N, bool>) return "bool";
    else if constexpr (std::is_same_v<N, float>) return "float32";
    else if constexpr (std::is_same_v<N, double>) return "float64";
    else if constexpr (std::is_same_v<N, std::uint8_t>) return "uint8";
    else if constexpr (std::is_same_v<N, std::uint16_t>) return "uint16";
    else if constexpr (std::is_same_v<N, std::int8_t>) return "int8";
    else if constexpr (std::is_same_v<N, std::int16_t>) return "int16";
    else if constexpr (std::is_same_v<N, std::int32_t>) return "int32";
    else {
        static_assert(std::is_same_v<N, std::int64_t>, "a type that no kernel takes");
        return "int64";
    }
}

// Whether numbers of a format of PEP 3118 are those of a type.
bool is_format(const char *format, Index item_size, char kind, Index size);

// Kind of number: b (bool), f (float), i (int), u (unsigned).
template <class T>
constexpr char kind_of() {
    if constexpr (std::is_same_v<std::remove_const_t<T>, bool>) return 'b';
    else if constexpr (std::is_floating_point_v<T>) return 'f';
    else return std::is_signed_v<T> ? 'i' : 'u';
}

// Fills a buffer, or throws what to tell; `expected` has `n` lengths, ANY where any will do.
void take(nb::handle given, Py_buffer &buffer, const char *name, const char *type, char kind, Index item_size,
          const Index *expected, int n, bool writable);

// Throws what to tell of a number that is not at least `low` and below `end`.
[[noreturn]] void refuse(Index number, const char *name, Index low, Index end);

// A copy with rows one after the other, of a buffer that has them apart; none of one that has not.
std::unique_ptr<char[]> contiguous(Py_buffer &buffer);

}  // namespace border

// An argument: an array that lives as long as this does. `Argument<const float, 2>` is read, `Argument<float, 2>` written.
// An array whose rows lie apart is copied, and what was written copied back.
template <class T, int N>
class Argument {
  public:
    Argument(nb::handle given, const char *name, const std::array<Index, N> &expected) {
        border::take(given, buffer_, name, border::name_of<T>(), border::kind_of<T>(), sizeof(T), expected.data(), N,
                     !std::is_const_v<T>);
        copy_ = border::contiguous(buffer_);
        array_.data = reinterpret_cast<T *>(copy_ ? copy_.get() : static_cast<char *>(buffer_.buf));
        for (int k = 0; k < N; k++) array_.shape[k] = buffer_.shape[k];
    }
    ~Argument() {
        if (!std::is_const_v<T> && copy_) PyBuffer_FromContiguous(&buffer_, copy_.get(), buffer_.len, 'C');
        PyBuffer_Release(&buffer_);
    }
    Argument(const Argument &) = delete;
    Argument &operator=(const Argument &) = delete;

    const Array<T, N> &operator*() const { return array_; }
    Index length(int axis) const { return array_.shape[axis]; }

  private:
    Py_buffer buffer_{};
    std::unique_ptr<char[]> copy_;
    Array<T, N> array_;
};

// Refuses places in another array that do not rise from 0 to `end`, as those where its pieces begin do.
void rising(Array<const Index, 1> places, const char *name, Index end);

// Refuses an argument of which something does not hold; `wanted` says what was expected.
void expect(bool holds, const char *name, const char *wanted);

// Refuses numbers that are not at least `low` and below `end`: places in another array.
template <class T>
void within(const T *numbers, Index n, const char *name, Index low, Index end) {
    for (Index k = 0; k < n; k++)
        if (Index(numbers[k]) < low || Index(numbers[k]) >= end) border::refuse(numbers[k], name, low, end);
}

template <class T, int N>
using Input = Argument<const T, N>;
template <class T, int N>
using Output = Argument<T, N>;

}  // namespace bodytrack
