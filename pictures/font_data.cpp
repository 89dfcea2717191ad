// The bytes of the font, taken into the program as they are. Licence: NOTICE.
#include "pictures/font_data.h"

asm(R"(
.section .rodata
.balign 16
splatvol_font_begin:
.incbin ")" SPLATVOL_FONT_FILE R"("
splatvol_font_end:
.previous
)");

extern "C" {
extern const unsigned char splatvol_font_begin[] __attribute__((visibility("hidden")));
extern const unsigned char splatvol_font_end[] __attribute__((visibility("hidden")));
}

namespace splatvol {

std::span<const unsigned char> font_bytes() { return {splatvol_font_begin, splatvol_font_end}; }

}  // namespace splatvol
