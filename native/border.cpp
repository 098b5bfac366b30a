#include "border.hpp"

#include <cstring>

namespace bodytrack {

void rising(Array<const Index, 1> places, const char *name, Index end) {
    bool good = places.size() > 0 && places[0] == 0 && places[places.size() - 1] == end;
    for (Index k = 1; good && k < places.size(); k++) good = places[k - 1] <= places[k];
    if (!good)
        throw nb::value_error((std::string(name) + ": expected places that rise from 0 to " + std::to_string(end)).c_str());
}

void expect(bool holds, const char *name, const char *wanted) {
    if (!holds) throw nb::value_error((std::string(name) + ": expected " + wanted).c_str());
}

namespace border {

void refuse(Index number, const char *name, Index low, Index end) {
    throw nb::value_error((std::string(name) + ": expected numbers from " + std::to_string(low) + " to " +
                           std::to_string(end - 1) + ", found " + std::to_string(number))
                              .c_str());
}

bool is_format(const char *format, Index item_size, char kind, Index size) {
    if (format == nullptr || item_size != size) return false;
    if (*format == '@' || *format == '=' || *format == '<') format++;
    if (std::strlen(format) != 1) return false;
    switch (kind) {
        case 'b': return *format == '?';
        case 'f': return std::strchr("fd", *format) != nullptr;
        case 'i': return std::strchr("bhilq", *format) != nullptr;
        default: return std::strchr("BHILQ", *format) != nullptr;
    }
}

namespace {

std::string shape_of(const Index *lengths, int n) {
    std::string text = "(";
    for (int k = 0; k < n; k++) {
        text += lengths[k] == ANY ? "any" : std::to_string(lengths[k]);
        if (k + 1 < n || n == 1) text += k + 1 < n ? ", " : ",";
    }
    return text + ")";
}

std::string found_in(nb::handle given, const char *attribute) {
    nb::object value = nb::getattr(given, attribute, nb::none());
    return value.is_none() ? std::string(nb::type_name(given.type()).c_str()) : std::string(nb::str(value).c_str());
}

}  // namespace

void take(nb::handle given, Py_buffer &buffer, const char *name, const char *type, char kind, Index item_size,
          const Index *expected, int n, bool writable) {
    const std::string wanted = std::string(name) + ": expected " + (writable ? "a writable" : "an") + " array of " +
                               type + " of shape " + shape_of(expected, n);
    const int flags = PyBUF_FORMAT | PyBUF_STRIDES;
    if (PyObject_GetBuffer(given.ptr(), &buffer, flags) != 0) {
        PyErr_Clear();
        throw nb::type_error((wanted + ", found " + found_in(given, "dtype")).c_str());
    }
    const bool typed = is_format(buffer.format, buffer.itemsize, kind, item_size);
    bool shaped = buffer.ndim == n;
    for (int k = 0; shaped && k < n; k++) shaped = expected[k] == ANY || buffer.shape[k] == expected[k];
    if (typed && shaped && (!writable || !buffer.readonly)) return;
    PyBuffer_Release(&buffer);
    if (!typed) throw nb::type_error((wanted + ", found " + found_in(given, "dtype")).c_str());
    if (!shaped) throw nb::value_error((wanted + ", found " + found_in(given, "shape")).c_str());
    throw nb::value_error((wanted + ", found it read-only").c_str());
}

std::unique_ptr<char[]> contiguous(Py_buffer &buffer) {
    if (PyBuffer_IsContiguous(&buffer, 'C')) return nullptr;
    std::unique_ptr<char[]> copy(new char[buffer.len]);
    if (PyBuffer_ToContiguous(copy.get(), &buffer, buffer.len, 'C') != 0) {
        PyBuffer_Release(&buffer);
        throw nb::python_error();
    }
    return copy;
}

}  // namespace border

}  // namespace bodytrack
