#include "builder/output/member.h"

namespace splatvol {

void Member::clear() {
  moments = {};
  plane = {};
  for (MemberValue& value : values) value.moments = {};
  splats.clear();
  value_rows.clear();
}

void Member::prefetch() const { prefetch_lines(this, sizeof(Member)); }

void Member::prefetch_vectors() const {
  prefetch_lines(values.data(), values.size() * sizeof(MemberValue));
  prefetch_lines(splats.data(), (splats.size() + 1) * sizeof(SplatRow));
  prefetch_lines(value_rows.data(), (value_rows.size() + values.size()) * sizeof(ValueRow));
}

}  // namespace splatvol
