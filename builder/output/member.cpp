#include "builder/output/member.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <new>

namespace splatvol {

// These make all parts of a block aligned.
static_assert(alignof(Member) <= __STDCPP_DEFAULT_NEW_ALIGNMENT__ && sizeof(MemberValue) % alignof(Member) == 0 &&
              sizeof(StoredSplat) % alignof(Member) == 0 && sizeof(StoredValue) % alignof(Member) == 0);

Member& Members::add() {
  Member& member = *new (add_block()) Member;
  member.attributes = static_cast<std::uint32_t>(attributes_);
  member.levels = static_cast<std::uint32_t>(levels_);
  std::ranges::uninitialized_value_construct(member.values());
  return member;
}

Member& Members::add(const Member& other) {
  const std::span<const std::byte> bytes = other.bytes();
  Member& member = *reinterpret_cast<Member*>(std::ranges::copy(bytes, add_block()).out - bytes.size());
  member.levels = static_cast<std::uint32_t>(levels_);
  return member;
}

void Members::add_splats(std::size_t first, std::span<const format::Attribute> attributes) {
  const std::size_t level = levels_ - 1;
  for (; first < size_; first += shapes_at_once) {
    const std::size_t count = std::min(size_ - first, shapes_at_once);
    std::array<const SpatialMoments*, shapes_at_once> moments{};
    for (std::size_t m = 0; m < count; ++m) moments[m] = &(*this)[first + m].moments;
    std::array<SplatShape, shapes_at_once> shapes;
    find_shapes(std::span(moments).first(count), shapes);
    for (std::size_t m = 0; m < count; ++m) {
      Member& member = (*this)[first + m];
      std::construct_at(&member.splat(level), MadeBy{[&] {
        return make_stored_splat(member.point.position, member.point.error, member.moments, shapes[m], member.plane);
      }});
      for (std::size_t a = 0; a < attributes.size(); ++a)
        std::construct_at(&member.stored_values(level)[a], MadeBy{[&] {
          return make_stored_value(member.values()[a].moments, shapes[m], attributes[a]);
        }});
    }
  }
}

void Members::erase_front(std::size_t count) {
  size_ -= count;
  for (std::size_t m = 0; count > 0 && m < size_; ++m) std::memcpy(block(m), block(m + count), bytes_);
}

std::byte* Members::add_block() {
  if (size_ == slab_members * slabs_.size())
    slabs_.push_back(std::make_unique_for_overwrite<std::byte[]>(slab_members * bytes_));
  return block(size_++);
}

}  // namespace splatvol
