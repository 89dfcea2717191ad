// render FILE.svol|URL OUT.png: draws a file with a view that fits it.
#include <splatvol/image.h>
#include <splatvol/renderer.h>

#include <cstdio>

int main(int argc, char** argv) {
  if (argc != 3) return std::fputs("usage: render FILE.svol OUT.png\n", stderr), 2;
  const auto fail = [](const splatvol::Error& error) {
    return std::fprintf(stderr, "render: %s\n", error.message.c_str()), 1;
  };

  auto renderer = splatvol::Renderer::open(argv[1]);
  if (!renderer) return fail(renderer.error());

  // A camera and a transfer function that fit the data, in another size.
  auto scene = renderer->fitting_scene("", 640, 480);
  if (!scene) return fail(scene.error());
  if (const auto set = renderer->set_scene(*scene); !set) return fail(set.error());

  // What is quickest with an error of at most 0.2 %.
  const auto image = renderer->render({.max_error = 0.002});
  if (!image) return fail(image.error());
  const auto written = splatvol::write_image(argv[2], *image, scene->background, {{"Title", scene->attribute}});
  if (!written) return fail(written.error());

  const splatvol::RenderStatistics& statistics = renderer->statistics();
  std::printf("%s: %s, %llu splats by %s in %.3f s, error %.5f\n", argv[2], scene->attribute.c_str(),
              static_cast<unsigned long long>(statistics.splats), renderer->device().c_str(), statistics.seconds,
              statistics.error);
}
