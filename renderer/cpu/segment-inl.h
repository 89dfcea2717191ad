// What a ray meets in a cell: where it enters and leaves. Included once for each instruction set.
#if defined(SPLATVOL_RENDERER_CPU_SEGMENT_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATVOL_RENDERER_CPU_SEGMENT_INL_H
#undef SPLATVOL_RENDERER_CPU_SEGMENT_INL_H
#else
#define SPLATVOL_RENDERER_CPU_SEGMENT_INL_H
#endif

#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {

/// 1/a with a relative error of 1e-7. Requires a normal number.
HWY_INLINE Float reciprocal(Float a) {
  const Float guess = hn::ApproximateReciprocal(a.v);
  const Float better = guess * fnma(a, guess, 2.0F);
  // Two steps for instruction sets with a rough guess; the second changes next to nothing elsewhere.
  return lane_count() == most_lanes ? better : better * fnma(a, better, 2.0F);
}

/// Where rays enter or leave.
struct Crossing {
  Float d, n, u;  // depth; the value is u + n z
};

HWY_INLINE Crossing select(Mask mask, const Crossing& yes, const Crossing& no) {
  return {select(mask, yes.d, no.d), select(mask, yes.n, no.n), select(mask, yes.u, no.u)};
}

/// 1/z, or 1 in orthographic projection, that turns values linear in the pixel into values.
template <bool orthographic>
HWY_INLINE Float z_at(Float d, Float w) {
  return orthographic ? Float(1.0F) : reciprocal(d + w);
}
HWY_INLINE Float depth_between(Float near_d, Float near_z, Float far_d, Float far_z) {
  return (near_d - far_d) * near_z * far_z;
}

}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
