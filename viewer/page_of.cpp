#include "viewer/page_of.h"

#include <utility>

#include "pictures/outline.h"

namespace splatvol {

Result<Image> page_of(const Session& session, const Page& page, const PageText& text, bool transparent) {
  SPLATVOL_TRY_ASSIGN(image, session.image());
  const Scene& scene = session.drawn_scene();
  const dvec3 ink = ink_on(scene.background);
  if (scene.outline) draw_outline(image, session.view(), session.bounds(), transparent ? ink_on_any() : ink);
  return compose_page(page, std::move(image), text, ink, transparent);
}

}  // namespace splatvol
