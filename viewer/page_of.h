// The picture of a session on a page.
#pragma once

#include "base/error.h"
#include "pictures/image.h"
#include "pictures/page.h"
#include "player/session.h"

namespace splatvol {

/// Returns the last picture of a session with its outline, if the scene has one, and with words round it. `page`: for a
/// picture of this size. Must not be called while the session `is_drawing`.
[[nodiscard]] Result<Image> page_of(const Session& session, const Page& page, const PageText& text,
                                    bool transparent = false);

}  // namespace splatvol
