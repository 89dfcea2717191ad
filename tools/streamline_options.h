// Options that tell which streamlines to follow.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "splatvol/streamlines.h"
#include "tools/command_line.h"

namespace splatvol {

/// Reads where streamlines begin: "X,Y,Z" is a position, "X,Y,Z:X,Y,Z:N" a line of N seeds, "X,Y,Z:X,Y,Z:X,Y,Z:NxM" a
/// rectangle by a corner and its neighbours, and "PATCH:N" a patch of the boundary.
[[nodiscard]] Result<Seeds> parse_seeds(const std::string& text);

struct StreamlineOptions {
  std::string vector;
  std::string seeds;  // parse_seeds takes it
  std::string direction = "both";
  std::optional<double> length;
  std::optional<std::size_t> steps;

  [[nodiscard]] bool are_given() const { return !vector.empty(); }
};

/// Adds the options to `app`. Parsing writes into `options`.
void add_streamline_options(CommandLine& app, StreamlineOptions& options);

/// Requires that the options are given, with seeds.
[[nodiscard]] Result<StreamlineRequest> request_of(const StreamlineOptions& options);

}  // namespace splatvol
