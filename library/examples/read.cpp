// read FILE.svol|URL: lists what a file holds, reads few points of it, and samples a line through its middle.
#include <splatvol/file.h>

#include <cstdio>

using Count = unsigned long long;

int main(int argc, char** argv) {
  if (argc != 2) return std::fputs("usage: read FILE.svol\n", stderr), 2;
  const auto fail = [](const splatvol::Error& error) {
    return std::fprintf(stderr, "read: %s\n", error.message.c_str()), 1;
  };

  const auto file = splatvol::File::open(argv[1]);
  if (!file) return fail(file.error());
  std::printf("%s: %llu points, %llu bytes\n", file->name().c_str(), Count{file->point_count()},
              Count{file->file_bytes()});
  for (const splatvol::Attribute& a : file->attributes())
    std::printf("  %s: %g to %g %s\n", a.name.c_str(), a.low, a.high, a.unit.c_str());

  // The finest resolution with at most 2000 points, and the volume that these stand for.
  const auto points = file->points({.max_points = 2000, .material = true});
  if (!points) return fail(points.error());
  double volume = 0;
  for (const double of_point : points->volumes) volume += of_point;
  std::printf("resolution %zu has %zu points, which stand for a volume of %g\n", points->resolution,
              points->positions.size(), volume);

  // The first attribute on a line through the middle, along x.
  const splatvol::Box box = file->bounds();
  std::vector<splatvol::dvec3> line;
  for (int i = 0; i < 9; ++i) {
    splatvol::dvec3 position = 0.5 * (box.low + box.high);
    position.x = box.low.x + (i + 0.5) / 9 * box.extent().x;
    line.push_back(position);
  }
  const auto values = file->sample(line, file->attributes().front().name);
  if (!values) return fail(values.error());
  for (std::size_t i = 0; i < line.size(); ++i) std::printf("  x = %7.3f: %g\n", line[i].x, (*values)[i]);
  std::printf("%llu bytes were read\n", Count{file->bytes_read()});
}
