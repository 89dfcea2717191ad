noperspective in vec2 s;
flat in vec4 form[far_form_count];
layout(location = 0) out vec4 pixel;

void main() { pixel = draw_far(s, form); }
