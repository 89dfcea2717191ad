// A point on its way through the resolutions.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <type_traits>
#include <vector>

#include "builder/mesh/boundary.h"
#include "builder/mesh/moments.h"
#include "builder/output/stored_splat.h"
#include "builder/sorting/morton.h"

namespace splatvol {

/// Most resolutions. Here they are counted from the finest, in levels: level 0 has all points. The number of levels is
/// known at the end.
inline constexpr std::size_t max_levels = 64;

struct MemberValue {
  float value = 0;       // of the point, as the file stores it
  vec3 gradient{0};      // unit vector, or 0
  ValueMoments moments;  // of the cluster
};

/// A point that stays for a coarser level, with the material of its cluster there. One block of memory holds it: behind
/// these fields come a value for each attribute, then the splats of all levels up to the present one.
struct Member {
  MortonKey key;
  std::uint64_t leaf = 0;                    // number of its index leaf
  std::uint64_t number = 0;                  // of the point, in Morton order
  std::uint32_t attributes = 0, levels = 0;  // values; splats that have room
  PointPosition point;
  SpatialMoments moments;  // about the point
  BoundaryPlane plane;

  /// Bytes of a block.
  [[nodiscard]] static constexpr std::size_t bytes_of(std::size_t attributes, std::size_t levels) {
    return sizeof(Member) + attributes * sizeof(MemberValue) +
           levels * (sizeof(StoredSplat) + attributes * sizeof(StoredValue));
  }
  [[nodiscard]] std::span<std::byte> bytes() { return {at<std::byte>(*this, 0), bytes_of(attributes, levels)}; }
  [[nodiscard]] std::span<const std::byte> bytes() const {
    return {at<const std::byte>(*this, 0), bytes_of(attributes, levels)};
  }

  [[nodiscard]] std::span<MemberValue> values() { return {at<MemberValue>(*this, sizeof(Member)), attributes}; }
  [[nodiscard]] std::span<const MemberValue> values() const {
    return {at<const MemberValue>(*this, sizeof(Member)), attributes};
  }
  [[nodiscard]] StoredSplat& splat(std::size_t level) { return *at<StoredSplat>(*this, bytes_of(attributes, level)); }
  [[nodiscard]] const StoredSplat& splat(std::size_t level) const {
    return *at<const StoredSplat>(*this, bytes_of(attributes, level));
  }

  /// The splat's values: [attribute].
  [[nodiscard]] std::span<StoredValue> stored_values(std::size_t level) {
    return {at<StoredValue>(*this, bytes_of(attributes, level) + sizeof(StoredSplat)), attributes};
  }
  [[nodiscard]] std::span<const StoredValue> stored_values(std::size_t level) const {
    return {at<const StoredValue>(*this, bytes_of(attributes, level) + sizeof(StoredSplat)), attributes};
  }

 private:
  template <class T, class M>
  static T* at(M& member, std::size_t offset) {
    using Byte = std::conditional_t<std::is_const_v<M>, const std::byte, std::byte>;
    return reinterpret_cast<T*>(reinterpret_cast<Byte*>(&member) + offset);
  }
};

/// Members with equally many levels, in slabs of memory that are used again.
class Members {
 public:
  Members(std::size_t attributes, std::size_t levels)
      : attributes_(attributes), levels_(levels), bytes_(Member::bytes_of(attributes, levels)) {}

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  [[nodiscard]] Member& operator[](std::size_t m) { return *reinterpret_cast<Member*>(block(m)); }
  [[nodiscard]] const Member& operator[](std::size_t m) const { return *reinterpret_cast<const Member*>(block(m)); }

  /// Adds a member without material. Its splats have any value.
  Member& add();

  /// Adds a copy. Further levels have any value. Requires that `other` has no more levels, and lies elsewhere.
  Member& add(const Member& other);

  /// Adds splats at the last level to the members from `first` on, made from their moments.
  void add_splats(std::size_t first, std::span<const format::Attribute> attributes);

  void erase_front(std::size_t count);
  void clear() { size_ = 0; }

 private:
  static constexpr std::size_t slab_members = 16;

  [[nodiscard]] std::byte* block(std::size_t m) const {
    return slabs_[m / slab_members].get() + m % slab_members * bytes_;
  }
  std::byte* add_block();

  std::size_t attributes_, levels_;
  std::size_t bytes_;  // of a member
  std::size_t size_ = 0;
  std::vector<std::unique_ptr<std::byte[]>> slabs_;
};

}  // namespace splatvol
