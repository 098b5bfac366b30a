// The module: refuses machines that it was not built for, then binds one folder after the other.
#include <nanobind/nanobind.h>

#ifdef _MSC_VER
#include <windows.h>
#endif

namespace nb = nanobind;

namespace bodytrack {

void bind_adjustment(nb::module_ &module);
void bind_body(nb::module_ &module);
void bind_contours(nb::module_ &module);
void bind_descent(nb::module_ &module);
void bind_images(nb::module_ &module);
void bind_movements(nb::module_ &module);
void bind_patches(nb::module_ &module);
void bind_pictures(nb::module_ &module);
void bind_projection(nb::module_ &module);
void bind_regions(nb::module_ &module);
void bind_skins(nb::module_ &module);

namespace {

bool machine_will_do() {
#if (defined(__x86_64__) || defined(_M_X64)) && defined(__GNUC__)
    __builtin_cpu_init();
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
#elif defined(_M_X64)
    return IsProcessorFeaturePresent(PF_AVX2_INSTRUCTIONS_AVAILABLE);
#else
    return true;
#endif
}

}  // namespace

}  // namespace bodytrack

NB_MODULE(_native, module) {
    if (!bodytrack::machine_will_do())
        throw nb::import_error("this processor has no AVX2, FMA and BMI2 (x86-64-v3: Intel from 2013, AMD from 2015), "
                               "which bodytrack needs; run it on a newer machine");
    module.attr("SOURCES") = BODYTRACK_SOURCES;
    bodytrack::bind_adjustment(module);
    bodytrack::bind_body(module);
    bodytrack::bind_contours(module);
    bodytrack::bind_descent(module);
    bodytrack::bind_images(module);
    bodytrack::bind_movements(module);
    bodytrack::bind_patches(module);
    bodytrack::bind_pictures(module);
    bodytrack::bind_projection(module);
    bodytrack::bind_regions(module);
    bodytrack::bind_skins(module);
}
