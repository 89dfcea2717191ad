// Arithmetic of vectors as the formulas have it. Included once for each instruction set.
#if defined(SPLATVOL_RENDERER_CPU_VECTOR_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATVOL_RENDERER_CPU_VECTOR_INL_H
#undef SPLATVOL_RENDERER_CPU_VECTOR_INL_H
#else
#define SPLATVOL_RENDERER_CPU_VECTOR_INL_H
#endif

#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include "renderer/cpu/frame.h"
#include "splat/constants.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using FloatTag = hn::CappedTag<float, most_lanes>;
using IntTag = hn::RebindToSigned<FloatTag>;
using Mask = hn::Mask<FloatTag>;

HWY_INLINE int lane_count() { return static_cast<int>(hn::Lanes(FloatTag())); }

/// Numbers of single precision, one in each lane.
struct Float {
  hn::Vec<FloatTag> v;

  Float() = default;
  HWY_INLINE Float(hn::Vec<FloatTag> vector) : v(vector) {}           // NOLINT(google-explicit-constructor)
  HWY_INLINE Float(float number) : v(hn::Set(FloatTag(), number)) {}  // NOLINT(google-explicit-constructor)
};

HWY_INLINE Float operator+(Float a, Float b) { return hn::Add(a.v, b.v); }
HWY_INLINE Float operator-(Float a, Float b) { return hn::Sub(a.v, b.v); }
HWY_INLINE Float operator*(Float a, Float b) { return hn::Mul(a.v, b.v); }
HWY_INLINE Float operator/(Float a, Float b) { return hn::Div(a.v, b.v); }
HWY_INLINE Float operator-(Float a) { return hn::Neg(a.v); }
HWY_INLINE Mask operator>(Float a, Float b) { return hn::Gt(a.v, b.v); }
HWY_INLINE Mask operator<(Float a, Float b) { return hn::Lt(a.v, b.v); }
HWY_INLINE Mask operator>=(Float a, Float b) { return hn::Ge(a.v, b.v); }
HWY_INLINE Mask operator<=(Float a, Float b) { return hn::Le(a.v, b.v); }

/// Returns a b + c, and c - a b.
HWY_INLINE Float fma(Float a, Float b, Float c) { return hn::MulAdd(a.v, b.v, c.v); }
HWY_INLINE Float fnma(Float a, Float b, Float c) { return hn::NegMulAdd(a.v, b.v, c.v); }

// Of a NaN and a number, instruction sets return one or the other: nothing below depends on it.
HWY_INLINE Float min(Float a, Float b) { return hn::Min(a.v, b.v); }
HWY_INLINE Float max(Float a, Float b) { return hn::Max(a.v, b.v); }
HWY_INLINE Float clamp(Float x, Float low, Float high) { return min(max(x, low), high); }
HWY_INLINE Float abs(Float a) { return hn::Abs(a.v); }
HWY_INLINE Float sqrt(Float a) { return hn::Sqrt(a.v); }
HWY_INLINE Float inverse_sqrt(Float a) { return Float(1.0F) / sqrt(a); }
HWY_INLINE Float select(Mask mask, Float yes, Float no) { return hn::IfThenElse(mask, yes.v, no.v); }
HWY_INLINE Float only(Mask mask, Float yes) { return hn::IfThenElseZero(mask, yes.v); }
HWY_INLINE Mask both(Mask a, Mask b) { return hn::And(a, b); }
HWY_INLINE Mask either(Mask a, Mask b) { return hn::Or(a, b); }
HWY_INLINE bool any(Mask mask) { return !hn::AllFalse(FloatTag(), mask); }
HWY_INLINE Mask is_number(Float a) { return hn::Eq(a.v, a.v); }
/// Bit i: whether lane i is in the mask.
HWY_INLINE std::uint32_t mask_bits(Mask mask) {
  std::array<std::uint8_t, 8> bytes{};
  hn::StoreMaskBits(FloatTag(), mask, bytes.data());
  return bytes[0] | static_cast<std::uint32_t>(bytes[1]) << 8;
}
HWY_INLINE Mask is_finite(Float a) { return hn::Lt(hn::Abs(a.v), hn::Set(FloatTag(), 3.4028235e38F)); }

/// Integers of 32 bits, one in each lane.
struct Int {
  hn::Vec<IntTag> v;

  Int() = default;
  HWY_INLINE Int(hn::Vec<IntTag> vector) : v(vector) {}                  // NOLINT(google-explicit-constructor)
  HWY_INLINE Int(std::int32_t number) : v(hn::Set(IntTag(), number)) {}  // NOLINT(google-explicit-constructor)
};

HWY_INLINE Int operator+(Int a, Int b) { return hn::Add(a.v, b.v); }
HWY_INLINE Int operator-(Int a, Int b) { return hn::Sub(a.v, b.v); }
HWY_INLINE Int operator*(Int a, Int b) { return hn::Mul(a.v, b.v); }
HWY_INLINE Int operator&(Int a, Int b) { return hn::And(a.v, b.v); }
HWY_INLINE Int operator|(Int a, Int b) { return hn::Or(a.v, b.v); }
HWY_INLINE Int min(Int a, Int b) { return hn::Min(a.v, b.v); }
HWY_INLINE Int max(Int a, Int b) { return hn::Max(a.v, b.v); }
template <int bits>
HWY_INLINE Int shift_left(Int a) {
  return hn::ShiftLeft<bits>(a.v);
}
/// Keeps the sign.
template <int bits>
HWY_INLINE Int shift_right(Int a) {
  return hn::ShiftRight<bits>(a.v);
}
/// The unsigned number of `count` bits from bit `first` on.
template <int first, int count>
HWY_INLINE Int bits_of(Int a) {
  const hn::RebindToUnsigned<FloatTag> tag;
  return hn::BitCast(IntTag(), hn::ShiftRight<32 - count>(hn::ShiftLeft<32 - first - count>(hn::BitCast(tag, a.v))));
}
template <int first, int count>
HWY_INLINE Int signed_bits_of(Int a) {
  return shift_right<32 - count>(shift_left<32 - first - count>(a));
}

HWY_INLINE Float to_float(Int a) { return hn::ConvertTo(FloatTag(), a.v); }
HWY_INLINE Int truncate(Float a) { return hn::ConvertTo(IntTag(), a.v); }
HWY_INLINE Int nearest(Float a) { return hn::NearestInt(a.v); }
HWY_INLINE Int bits_as_int(Float a) { return hn::BitCast(IntTag(), a.v); }
HWY_INLINE Float bits_as_float(Int a) { return hn::BitCast(FloatTag(), a.v); }
HWY_INLINE Mask mask_of(hn::Mask<IntTag> mask) { return hn::RebindMask(FloatTag(), mask); }
HWY_INLINE Mask is_zero(Int a) { return mask_of(hn::Eq(a.v, hn::Zero(IntTag()))); }

HWY_INLINE Float load(const float* numbers) { return hn::LoadU(FloatTag(), numbers); }
HWY_INLINE Int load(const std::int32_t* numbers) { return hn::LoadU(IntTag(), numbers); }
HWY_INLINE void store(Float a, float* numbers) { hn::StoreU(a.v, FloatTag(), numbers); }
HWY_INLINE void store(Int a, std::int32_t* numbers) { hn::StoreU(a.v, IntTag(), numbers); }
HWY_INLINE Float gather(const float* numbers, Int index) { return hn::GatherIndex(FloatTag(), numbers, index.v); }

HWY_INLINE Int select_int(Mask mask, Int yes, Int no) {
  return hn::IfThenElse(hn::RebindMask(IntTag(), mask), yes.v, no.v);
}

/// 0, 1, 2 ...
HWY_INLINE Float lane_numbers() { return hn::Iota(FloatTag(), 0.0F); }
HWY_INLINE Int lane_indices() { return hn::Iota(IntTag(), 0); }

/// Returns the base-2 logarithm of a positive normal number, with a relative error of 1e-6.
HWY_INLINE Float log2(Float x) {
  const Int bits = bits_as_int(x);
  const Int exponent = shift_right<23>(bits - Int(0x3f3504f3));
  const Float m = bits_as_float(bits - shift_left<23>(exponent)) - 1.0F;
  Float p = fma(m, 0.16818659F, -0.26796387F);
  p = fma(m, p, 0.29611956F);
  p = fma(m, p, -0.35952446F);
  p = fma(m, p, 0.48061313F);
  p = fma(m, p, -0.72136018F);
  p = fma(m, p, 1.4426965F);
  return fma(m, p, to_float(exponent));
}

HWY_INLINE Float natural_log(Float x) { return log2(x) * 0.69314718F; }

/// Returns the cube root of a number >= 0, with a relative error of 1e-6; of 0 a number under 1e-12.
HWY_INLINE Float cube_root(Float x) {
  // A third of the exponent and the mantissa together is within 4 %. Each step of Newton's squares the error.
  const Int bits = nearest(fma(to_float(bits_as_int(x)), 1.0F / 3, 709921077.0F));
  Float root = bits_as_float(bits);
  for (int step = 0; step < 2; ++step) root = fma(x / (root * root), 1.0F / 3, root * (2.0F / 3));
  return root;
}

/// Return the scatter of a splat's gradients, and their mean |cos| with the line of sight (docs/design.md, "A splat").
HWY_INLINE Float scatter_of(Float unexplained, Float explained) {
  return min(unexplained / max(explained * 1.5F, 1e-30F), 1e6F);
}
HWY_INLINE Float mean_cosine(Float cosine, Float scatter) {
  const Float across = sqrt(scatter * drawing::scatter_across);
  return cube_root(fma(cosine * cosine, cosine, across * across * across)) /
         sqrt(fma(scatter, drawing::scatter_length, 1.0F));
}

/// Adding it rounds numbers up to 2^21 to integers, which are the last bits of the sum. Conversions take longer.
constexpr float rounding = 12582912.0F;

/// Returns 1 - exp(-depth) without cancellation, with a relative error of 1e-6. Requires depth >= 0.
HWY_INLINE Float opacity(Float depth) {
  const Float y = max(depth * -1.44269504F, -100.0F);
  const Float rounded = y + rounding;
  const Float f = y - (rounded - rounding);
  Float p = fma(f, 0.0013381303F, 0.0096663685F);
  p = fma(f, p, 0.05550381F);
  p = fma(f, p, 0.24022349F);
  p = fma(f, p, 0.69314718F) * f;
  const Float scale = bits_as_float(shift_left<23>(bits_as_int(rounded) + Int(127)));
  return fnma(scale, p, Float(1.0F) - scale);
}

struct Vector2 {
  Float x, y;
};
HWY_INLINE Vector2 operator+(Vector2 a, Vector2 b) { return {a.x + b.x, a.y + b.y}; }
HWY_INLINE Vector2 operator-(Vector2 a, Vector2 b) { return {a.x - b.x, a.y - b.y}; }
HWY_INLINE Vector2 operator*(Vector2 a, Float b) { return {a.x * b, a.y * b}; }
HWY_INLINE Float dot(Vector2 a, Vector2 b) { return fma(a.x, b.x, a.y * b.y); }
HWY_INLINE Float length(Vector2 a) { return sqrt(dot(a, a)); }
HWY_INLINE Vector2 select(Mask mask, Vector2 yes, Vector2 no) {
  return {select(mask, yes.x, no.x), select(mask, yes.y, no.y)};
}

struct Vector3 {
  Float x, y, z;
};
HWY_INLINE Vector3 operator+(Vector3 a, Vector3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
HWY_INLINE Vector3 operator-(Vector3 a, Vector3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
HWY_INLINE Vector3 operator*(Vector3 a, Vector3 b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
HWY_INLINE Vector3 operator*(Vector3 a, Float b) { return {a.x * b, a.y * b, a.z * b}; }
/// Returns a b + c.
HWY_INLINE Vector3 fma(Vector3 a, Float b, Vector3 c) { return {fma(a.x, b, c.x), fma(a.y, b, c.y), fma(a.z, b, c.z)}; }
HWY_INLINE Float dot(Vector3 a, Vector3 b) { return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z)); }
HWY_INLINE Float length(Vector3 a) { return sqrt(dot(a, a)); }
HWY_INLINE Vector3 cross(Vector3 a, Vector3 b) {
  return {fnma(a.z, b.y, a.y * b.z), fnma(a.x, b.z, a.z * b.x), fnma(a.y, b.x, a.x * b.y)};
}
HWY_INLINE Vector3 select(Mask mask, Vector3 yes, Vector3 no) {
  return {select(mask, yes.x, no.x), select(mask, yes.y, no.y), select(mask, yes.z, no.z)};
}

/// Returns the row of the transfer table for a spread (moments_common.glsl), and the columns that a unit of the mean
/// takes there. A spread beyond the last row uses this row on a larger scale. NaN, of a lane that is not drawn, has a
/// row, too.
struct TableRow {
  Int row;
  Float columns;
};
template <class Table>
HWY_INLINE TableRow table_row(const Table& table, Float spread) {
  constexpr float rows_per_octave = 1.0F / 9.00281502F;  // 1 / log2(513)
  const int last = table.rows - 1;
  const Float share = min(log2(fma(spread, 64.0F, 1.0F)) * rows_per_octave, 1.0F);
  const Int row = max(min(truncate(fma(share, static_cast<float>(last), 0.5F)), Int(last)), Int(0));
  const Float row_spread = gather(table.row_spreads, row);
  const Mask is_last = mask_of(hn::Eq(row.v, Int(last).v));
  const Float used = select(is_last, max(spread, row_spread), row_spread);
  return {row, Float(table.inner_columns()) / fma(used, 8.0F, 1.0F)};
}

}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
