// svinfo --integrate: integrals over the cells that a file keeps, or over a surface in them.
#pragma once

#include <string>
#include <vector>

#include "format/volume.h"
#include "tools/command_line.h"

namespace splatvol {

struct IntegralOptions {
  bool integrate = false;
  std::vector<double> box;               // two corners; empty: none
  std::vector<std::string> clip_planes;  // parse_plane takes them
  std::vector<std::string> ranges;       // NAME=A:B
  std::string contour;                   // NAME=VALUE; empty: none
  std::string slice;                     // as a plane; empty: none
  std::string flux;                      // a vector; empty: none
  std::string memory;
};

/// Adds --integrate and the options that need it.
void add_integral_options(CommandLine& app, IntegralOptions& options);

/// Ends the parsing if the corners of the box are exchanged.
void check_integral_options(const IntegralOptions& options);

/// Prints the integrals of attributes (empty: all), as text or JSON.
[[nodiscard]] Status print_integrals(const format::Volume& volume, const IntegralOptions& options,
                                     const std::vector<std::string>& attributes, bool as_json);

}  // namespace splatvol
