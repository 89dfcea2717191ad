// Gmsh's .msh files, as they are.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"

namespace splatvol {

/// Values of a step of a view for some nodes or elements.
struct GmshView {
  enum class At { nodes, elements, element_nodes };
  At at = At::nodes;
  std::string name;
  double time = 0;
  std::int64_t step = 0;
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
  std::vector<int> materials;        // of volumes: the first of their physical groups, by its number; 0: none
};

/// A physical group of surfaces.
struct GmshGroup {
  std::string name;
  std::vector<std::size_t> elements;  // surface elements, by their indices in GmshElements
};

/// A file of version 2.2 or 4.1, ascii or binary. Periodic links, partitions, and physical groups of curves and
/// points are left out.
struct GmshFile {
  std::vector<std::uint64_t> node_tags;
  std::vector<dvec3> points;
  GmshElements elements;
  std::vector<GmshView> views;    // a step may be in several sections
  std::vector<GmshGroup> groups;  // by their names, each with an element at least; only if they are asked for
  bool may_repeat = false;        // version 2.2 repeats an element for each of its physical groups
};

/// Number of nodes of an element type; empty for types that are not known.
[[nodiscard]] std::optional<std::size_t> gmsh_node_count(int type);

/// Reads a file. `groups`: the physical groups are wanted, too. Those of one name are one group; one without a name is
/// called "physical surface" and its number. Fails if the file is damaged or cut off, or of another version, and if a
/// surface is in more than 64 physical groups. Safe on untrusted bytes: allocates no more than a multiple of them.
[[nodiscard]] Result<GmshFile> read_gmsh(const std::string& path, bool groups);

/// Reads the headers of the views alone: their names, times, components, and where they are. Finds the ends of all
/// sections by their last lines. Fails as read_gmsh, as far as that is read.
[[nodiscard]] Result<std::vector<GmshView>> read_gmsh_views(const std::string& path);

}  // namespace splatvol
