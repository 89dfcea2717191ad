#include "tools/export/splat_groups.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <vector>

namespace splatvol {
namespace {

constexpr std::uint64_t groups_at_once = 32;

}  // namespace

Status for_each_group(const format::SplatReader& reader, format::SplatReader::Parts parts,
                      const std::function<Status(const format::SplatGroup&)>& visit,
                      const std::function<void(double)>& progress) {
  const std::uint64_t count = reader.group_count();
  for (std::uint64_t first = 0; first < count; first += groups_at_once) {
    std::vector<Result<format::SplatGroup>> groups(std::min(groups_at_once, count - first));
    tbb::parallel_for(std::size_t{0}, groups.size(), [&](std::size_t g) { groups[g] = reader.read(first + g, parts); });
    for (const Result<format::SplatGroup>& group : groups) {
      if (!group) return tl::unexpected(group.error());  // SPLATVOL_TRY would copy the group
      SPLATVOL_TRY(visit(*group));
    }
    progress(static_cast<double>(first + groups.size()) / static_cast<double>(count));
  }
  return {};
}

}  // namespace splatvol
