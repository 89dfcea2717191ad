// build OUT.svol: writes a file from a mesh in memory, a box of hexahedra with a vortex ring in it.
#include <splatvol/build.h>

#include <cmath>
#include <cstdio>
#include <vector>

int main(int argc, char** argv) {
  if (argc != 2) return std::fputs("usage: build OUT.svol\n", stderr), 2;

  // Points of a lattice from -1 to 1, x fastest, and the speed at each.
  constexpr std::int64_t n = 41;
  std::vector<double> points, speeds;
  for (std::int64_t i = 0; i < n * n * n; ++i) {
    const double x = 2.0 * (i % n) / (n - 1) - 1, y = 2.0 * (i / n % n) / (n - 1) - 1,
                 z = 2.0 * (i / (n * n)) / (n - 1) - 1;
    points.insert(points.end(), {x, y, z});
    const double from_ring = std::hypot(std::hypot(x, y) - 0.6, z);
    speeds.push_back(10 * std::exp(-25 * from_ring * from_ring));
  }

  // The eight points of each hexahedron, in VTK's order.
  std::vector<std::int64_t> connectivity, offsets{0};
  for (std::int64_t z = 0; z + 1 < n; ++z)
    for (std::int64_t y = 0; y + 1 < n; ++y)
      for (std::int64_t x = 0; x + 1 < n; ++x) {
        for (const std::int64_t layer : {z, z + 1})
          for (const std::int64_t corner : {n * y + x, n * y + x + 1, n * (y + 1) + x + 1, n * (y + 1) + x})
            connectivity.push_back(n * n * layer + corner);
        offsets.push_back(static_cast<std::int64_t>(connectivity.size()));
      }
  const std::vector<std::uint8_t> types(offsets.size() - 1, 12);  // VTK_HEXAHEDRON

  splatvol::MeshArrays mesh{.points = points, .connectivity = connectivity, .offsets = offsets, .types = types};
  mesh.point_values.push_back({.name = "speed", .values = speeds, .unit = "m/s"});
  const auto report = splatvol::build(mesh, argv[1], {.up = 'z', .name = "ring"});
  if (!report) return std::fprintf(stderr, "build: %s\n", report.error().message.c_str()), 1;

  std::printf("%s: %zu cells, %llu points in %zu resolutions, %llu bytes\n", argv[1], types.size(),
              static_cast<unsigned long long>(report->resolution_counts.back()), report->resolution_counts.size(),
              static_cast<unsigned long long>(report->file_bytes));
  for (const std::string& warning : report->warnings) std::printf("  %s\n", warning.c_str());
}
