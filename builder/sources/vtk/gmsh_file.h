// Gmsh's .msh files, as they are.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"

namespace splatvol {

/// Values of a view for some nodes or elements.
struct GmshView {
  enum class At { nodes, elements, element_nodes };
  At at = At::nodes;
  std::string name;
  double time = 0;
  std::size_t components = 1;
  std::vector<std::uint64_t> tags;    // of the nodes or elements
  std::vector<std::uint32_t> counts;  // [tag]: of an element's nodes, for element_nodes
  std::vector<double> values;         // [tag][node of an element][component]
};

/// Elements of one file, in its order.
struct GmshElements {
  std::vector<int> types;  // Gmsh's numbers
  std::vector<std::uint64_t> tags;
  std::vector<std::uint64_t> nodes;  // tags, of one element after the other
};

/// A file of version 2.2 or 4.1, ascii or binary. Physical groups, entities and periodic links are left out.
struct GmshFile {
  std::vector<std::uint64_t> node_tags;
  std::vector<dvec3> points;
  GmshElements elements;
  std::vector<GmshView> views;
  bool may_repeat = false;  // version 2.2 repeats an element for each of its physical groups
};

/// Number of nodes of an element type; empty for types that are not known.
[[nodiscard]] std::optional<std::size_t> gmsh_node_count(int type);

/// Reads a file. Fails if it is damaged or cut off, or of another version. Safe on untrusted bytes: allocates no more
/// than a multiple of them.
[[nodiscard]] Result<GmshFile> read_gmsh(const std::string& path);

}  // namespace splatvol
