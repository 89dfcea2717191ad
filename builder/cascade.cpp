#include "builder/cascade.h"

#include <algorithm>
#include <array>
#include <utility>

namespace splatvol {
namespace {

// A cluster's member that goes on, with the material of all.
Member merge_leaf(std::span<Member> members, std::size_t kept) {
  Member merged = std::move(members[kept]);
  const SpatialMoments own = std::exchange(merged.moments, {});
  std::vector<ValueMoments> own_values;
  for (MemberValue& value : merged.values) own_values.push_back(std::exchange(value.moments, {}));
  std::vector<BoundaryPlane> planes;
  std::vector<dvec3> shifts;
  for (std::size_t m = 0; m < members.size(); ++m) {
    const bool other = m != kept;
    const dvec3 shift = other ? members[m].point.position - merged.point.position : dvec3(0);
    merge(merged.moments, other ? members[m].moments : own, shift);
    for (std::size_t a = 0; a < merged.values.size(); ++a)
      merge(merged.values[a].moments, other ? members[m].values[a].moments : own_values[a], shift);
    const BoundaryPlane& plane = other ? members[m].plane : merged.plane;
    if (plane.area == dvec3(0)) continue;
    planes.push_back(plane);
    shifts.push_back(shift);
  }
  merged.plane = merge_planes(planes, shifts);
  return merged;
}

}  // namespace

void add_splat(Member& member, std::span<const double> offsets) {
  member.splats.push_back(make_splat_row(member.point.position, member.point.error, member.moments, member.plane));
  for (std::size_t a = 0; a < offsets.size(); ++a)
    member.value_rows.push_back(make_value_row(member.values[a].moments, member.splats.back().shape, offsets[a]));
}

void Cascade::add_to_last(const Member& other, std::uint64_t parts) {
  Step& step = steps_[1];
  Member& last = step.members.back();
  merge(last.moments, other.moments, dvec3(0));
  for (std::size_t a = 0; a < offsets_.size(); ++a) merge(last.values[a].moments, other.values[a].moments, dvec3(0));
  last.plane = merge_planes(std::array{last.plane, other.plane}, std::array{dvec3(0), dvec3(0)});
  const std::uint64_t number = last.splats.back().number;
  last.splats.pop_back();
  last.value_rows.resize(last.value_rows.size() - offsets_.size());
  add_splat(last, offsets_);
  last.splats.back().number = number;
  step.parts.back() += parts;
}

void Cascade::push(std::size_t step, Member&& member, std::uint64_t parts) {
  Step& at = steps_[step];
  member.splats.back().number = at.count++;
  at.members.push_back(std::move(member));
  at.parts.push_back(parts);
  if (at.reduces()) close_leaves(step, false);
}

// The first member's leaf is known once there are enough behind it to split any larger cell; it is whole then too, as
// no two members share the finest cell.
void Cascade::close_leaves(std::size_t step, bool at_end) {
  Step& at = steps_[step];
  while (!at.members.empty() && (at_end || at.members.size() > leaf_points_)) {
    const MortonKey& first = at.members.front().key;
    const MortonKey* beyond = at.members.size() > leaf_points_ ? &at.members[leaf_points_].key : nullptr;
    const int depth = leaf_depth(at.before ? common_depth(*at.before, first) : -1, first, beyond);
    std::size_t size = 1;
    while (size < at.members.size() && common_depth(first, at.members[size].key) >= depth) ++size;
    close_leaf(step, size, depth);
  }
}

void Cascade::close_leaf(std::size_t step, std::size_t size, int depth) {
  Step& at = steps_[step];
  std::vector<Member> members;
  for (std::size_t m = 0; m < size; ++m) {
    members.push_back(std::move(at.members.front()));
    at.members.pop_front();
    SplatRow& splat = members.back().splats.back();
    splat.depth = static_cast<std::uint8_t>(depth);
    splat.count = static_cast<std::uint8_t>(std::min<std::size_t>(size, 255));
    sink_.splat(step, members.back(), at.next_part);
    at.next_part += at.parts.front();
    at.parts.pop_front();
  }
  at.before = members.back().key;

  if (!at.reduces() || step + 1 == max_steps) {
    for (Member& member : members) sink_.point(step, std::move(member));
    return;
  }
  const std::size_t kept =
      nearest_to_center(cube_, depth, size, [&](std::size_t m) { return members[m].point.position; });
  Member merged = merge_leaf(members, kept);
  for (std::size_t m = 0; m < size; ++m)
    if (m != kept) sink_.point(step, std::move(members[m]));
  add_splat(merged, offsets_);
  push(step + 1, std::move(merged), size);
}

void Cascade::finish() {
  for (std::size_t step = 1; step < steps_.size() && steps_[step].count > 0; ++step) close_leaves(step, true);
}

std::uint64_t Cascade::first_open_leaf() const {
  std::uint64_t first = std::numeric_limits<std::uint64_t>::max();
  for (const Step& step : steps_)
    if (!step.members.empty()) first = std::min(first, step.members.front().leaf);
  return first;
}

std::vector<std::uint64_t> Cascade::counts() const {
  std::vector<std::uint64_t> counts;
  for (std::size_t step = 1; step < steps_.size() && steps_[step].count > 0; ++step)
    counts.push_back(steps_[step].count);
  return counts;
}

}  // namespace splatvol
