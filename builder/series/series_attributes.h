// The attributes that the steps of a series have in common: those of any of them.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/array_union.h"
#include "builder/sources/source.h"
#include "builder/sources/step_group.h"

namespace splatvol {

/// A time step, before its attributes are chosen.
struct StepInput {
  std::string name;            // as in SeriesStep
  std::optional<double> time;  // as in SeriesStep
  SourceOptions options;
  std::function<Result<std::unique_ptr<Source>>(const SourceOptions&)> open;
  std::function<Result<std::optional<std::vector<ArrayShape>>>(const SourceOptions&)> list;  // as ListArrays
};

/// Makes the steps of a series. Lists the arrays of all steps first: each gets the attributes that any of them has, in
/// the order of the first, or those that the options select. Where a step lacks one, all its values are missing.
///
/// `series`: the attributes of a series to which the steps are appended; empty: the series is new. Appended steps get
/// these attributes. Fails if a step has others and the options select none, and if arrays of one name have different
/// numbers of components.
[[nodiscard]] Result<std::vector<SeriesStep>> make_steps(std::vector<StepInput> inputs,
                                                         const std::vector<std::string>& series);

}  // namespace splatvol
