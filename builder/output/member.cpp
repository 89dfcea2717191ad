#include "builder/output/member.h"

#include "builder/output/prefetch.h"

namespace splatvol {

void Member::clear() {
  moments = {};
  plane = {};
  for (MemberValue& value : values) value.moments = {};
  splats.clear();
  stored_values.clear();
}

void Member::prefetch() const { prefetch_lines(this, sizeof(Member)); }

void Member::prefetch_vectors() const {
  prefetch_lines(values.data(), values.size() * sizeof(MemberValue));
  prefetch_lines(splats.data(), (splats.size() + 1) * sizeof(StoredSplat));
  prefetch_lines(stored_values.data(), (stored_values.size() + values.size()) * sizeof(StoredValue));
}

}  // namespace splatvol
