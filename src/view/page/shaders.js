// The programs of the graphics card.
//
// Blocks are drawn into two targets at once: what is needed to light a pixel (normal, kind of face) and the id of the
// thing there. Colours come in a second step from the ids, so that painting 200,000 cells is one small texture.

/** Kinds of a pixel, in the last byte of the first target. */
export const FACE = { none: 0, back: 128, cap: 192, front: 255 };

/** The width of the table of colours. */
export const TABLE_WIDTH = 4096;

const head = (extension = "") => `#version 300 es
${extension}
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp sampler2D;
`;
const HEAD = head();

// The entry of a thing: its colour, and its state: bit 0 shown, bit 1 chosen.
const ENTRY = `
uniform usampler2D table;
uniform uint limit;
uvec4 entry(uint id) {
  uint i = id < limit ? id : 0u;
  return texelFetch(table, ivec2(int(i & ${TABLE_WIDTH - 1}u), int(i >> ${Math.log2(TABLE_WIDTH)}u)), 0);
}
`;

// The octahedron's lower half, turned out over its upper one, and back again.
const FOLD = `
vec2 fold(vec2 n) { return (1.0 - abs(n.yx)) * vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0); }
vec3 unfold(vec2 code) {
  float z = 1.0 - abs(code.x) - abs(code.y);
  return vec3(z < 0.0 ? fold(code) : code, z);
}
`;

// The kind of a pixel, from the last byte of the first target.
const KIND = `
uniform sampler2D faces;
int kindOf(vec4 face) { return int(face.a * 255.0 + 0.5); }
`;

// What faces are filled with where a line of sight meets the plane of a slice or a face of the volume.
const SHEET = `
in vec3 place;
in vec2 share;
uniform mat4 matrix;
uniform vec4 plane;
out vec2 at;
out float beyond;
void main() {
  at = share;
  beyond = dot(plane.xyz, place) - plane.w;
  gl_Position = matrix * vec4(place, 1.0);
}`;

// That depths are only made greater keeps the card's early tests, where it knows the word.
const greater = (known) => (known ? "layout(depth_greater) out highp float gl_FragDepth;" : "");

// Where things are left out, a vertex looks up whether its own is shown, which takes a sixth of the time of drawing.
const block = (all, conservative) => ({
  attributes: ["corner", "normal", "extra"],
  vertex: `${HEAD}${all ? "" : ENTRY}${FOLD}
in uvec4 corner;   // place on the lattice from the block's origin, low bits of the slot
in vec2 normal;    // octahedral
in uvec2 extra;    // high bits of the slot, flags (1: cap, 2: fin between levels, 4: its side in the cell)
uniform mat4 matrix;
uniform mat3 turn;       // to right, up and back of the picture, of normals that are no unit vectors yet
uniform ivec3 base;      // the block's origin on the lattice, from the lattice point next to the eye
uniform int stride;      // lattice steps in a step of the block
uniform vec3 step;       // length of a step of the lattice
uniform vec3 rest;       // that lattice point from the eye
uniform vec4 plane;      // what is beyond it is cut off
uniform usampler2D slots;
uniform int wide;        // slots in a row of their texture
uniform int kind;        // 0 surfaces, 1 cells, 2 objects
flat out uint id;
flat out float cap;
out float fin;
out vec3 facing;
out float beyond;
void main() {
  int slot = int(corner.w | (extra.x << 16u));
  uvec4 ids = texelFetch(slots, ivec2(slot % wide, slot / wide), 0);
  id = kind == 0 ? ids.x : kind == 1 ? ids.y : ids.z;
  cap = float(extra.y & 1u);
  fin = (extra.y & 2u) == 0u ? 0.0 : (extra.y & 4u) == 0u ? -1.0 : 1.0;
  facing = turn * unfold(normal);
  // the sum is one of integers, so that blocks that share a corner put it at the same place to the last bit
  vec3 place = vec3(base + ivec3(corner.xyz) * stride) * step + rest;
  beyond = dot(plane.xyz, place) - plane.w;
  gl_Position = matrix * vec4(place, 1.0);
  ${all ? "" : "if ((entry(id).a & 1u) == 0u) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);"}
}`,
  fragment: `${head(conservative ? "#extension GL_EXT_conservative_depth : require" : "")}${FOLD}
${greater(conservative)}
flat in uint id;
flat in float cap;
in float fin;            // below 0 in material, above 0 in the cell, whichever way a fin is looked at
in vec3 facing;
in float beyond;
uniform float behind;    // by how much fronts have precedence at edges, of whose two sides either may be nearer as depths tell
layout(location = 0) out vec4 face;
layout(location = 1) out uint thing;
void main() {
  if (beyond > 0.0) discard;
  vec3 n = normalize(facing);
  n.xy /= abs(n.x) + abs(n.y) + abs(n.z);
  if (n.z < 0.0) n.xy = fold(n.xy);
  bool front = fin == 0.0 ? gl_FrontFacing : fin > 0.0;
  float what = front ? (cap > 0.5 ? 192.0 : 255.0) : 128.0;
  face = vec4(n.xy * 0.5 + 0.5, 0.0, what / 255.0);
  thing = id;
  gl_FragDepth = front ? gl_FragCoord.z : gl_FragCoord.z + behind;
}`,
});

/** Blocks of which all is shown, and those of which some is left out. */
export const blocks = (conservative) => ({ BLOCK: block(true, conservative), BLOCK_PART: block(false, conservative) });

// One triangle over the whole picture.
const WHOLE = `#version 300 es
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`;

// Eight places around a pixel, every other one farther away.
const AROUND = `
const vec2 around[8] = vec2[8](vec2(1, 0), vec2(1.77, 1.77), vec2(0, 1), vec2(-1.77, 1.77), vec2(-1, 0), vec2(-1.77, -1.77), vec2(0, -1), vec2(1.77, -1.77));
`;

// An outline around what is chosen, outside of it, and a breath of its colour inside.
const OUTLINE = `
uniform vec3 accent;
bool chosen(ivec2 p) {
  p = clamp(p, ivec2(0), last);
  int k = kindOf(texelFetch(faces, p, 0));
  if (k == 0 || (k == cutKind && !cutOwn)) return false;
  return (entry(texelFetch(things, p, 0).r).a & 2u) != 0u;
}
vec3 outlined(ivec2 p, vec3 shade) {
  if (chosen(p)) return mix(shade, accent, 0.14);
  for (int i = 0; i < 8; i++) {
    if (chosen(p + ivec2(round(normalize(around[i]) * 2.0 * dot_size)))) return accent;
  }
  return shade;
}
`;

const light = (chosen) => ({
  attributes: [],
  vertex: WHOLE,
  fragment: `${HEAD}${ENTRY}${FOLD}${KIND}${AROUND}
uniform usampler2D things;
uniform sampler2D depths;
uniform vec3 cut;        // colour of material that is cut
uniform vec3 top;        // background
uniform vec3 bottom;
uniform vec2 span;       // lowest row of the whole picture that is drawn, and the rows of the whole
uniform int cutKind;     // the kind of face that one sees where the body before it is cut; 0 for none
uniform bool cutOwn;     // cut faces have the colours of their things
uniform bool flatView;
uniform vec3 range;      // near, far, height of the picture at its middle
uniform float dot_size;  // pixels of the screen in a pixel of the layout
out vec4 colour;
ivec2 last;
// how far what a pixel shows is away
float away(ivec2 p) {
  float d = texelFetch(depths, clamp(p, ivec2(0), last), 0).r;
  return flatView ? mix(range.x, range.y, d) : range.x * range.y / (range.y - d * (range.y - range.x));
}
${chosen ? OUTLINE : ""}// At the edge of a surface depths do not always tell which of its sides is nearer: a pixel that differs from all four
// beside it, which are alike and not empty, shows what they do.
ivec2 settled(ivec2 p) {
  int own = kindOf(texelFetch(faces, p, 0));
  ivec2 low = max(p - 1, ivec2(0));
  ivec2 high = min(p + 1, last);
  int kind = kindOf(texelFetch(faces, ivec2(low.x, p.y), 0));
  bool alike = kind != 0 && kind == kindOf(texelFetch(faces, ivec2(high.x, p.y), 0))
    && kind == kindOf(texelFetch(faces, ivec2(p.x, low.y), 0)) && kind == kindOf(texelFetch(faces, ivec2(p.x, high.y), 0));
  return alike && kind != own ? ivec2(low.x, p.y) : p;
}
vec3 lit(vec2 code, uint id, bool cap) {
  vec3 n = normalize(unfold(code * 2.0 - 1.0));
  if (n.z < 0.0) n = -n;
  float light = 0.30 + 0.52 * max(dot(n, normalize(vec3(-0.35, 0.55, 0.75))), 0.0) + 0.22 * n.z;
  if (cap) return cut * (0.55 + 0.45 * light);
  float gleam = pow(max(dot(n, normalize(vec3(-0.25, 0.4, 1.3))), 0.0), 40.0) * 0.10;
  return vec3(entry(id).rgb) / 255.0 * light + gleam;
}
// what lies behind something near is darker: depth is seen without shadows
float shadow(ivec2 p) {
  float here = away(p);
  float sum = 0.0;
  for (int i = 0; i < 8; i++) {
    float there = away(p + ivec2(round(around[i] * dot_size)));
    sum += clamp((here - there) / (flatView ? range.z : here) * 24.0, 0.0, 1.0);
  }
  return 1.0 - sum / 16.0;
}
void main() {
  last = textureSize(faces, 0) - 1;
  ivec2 p = settled(ivec2(gl_FragCoord.xy));
  vec4 face = texelFetch(faces, p, 0);
  int kind = kindOf(face);
  vec3 shade;
  if (kind == 0) shade = mix(bottom, top, (gl_FragCoord.y + span.x) / span.y);
  else if (kind == cutKind) shade = cutOwn ? vec3(entry(texelFetch(things, p, 0).r).rgb) * (0.8 / 255.0) : cut;
  else shade = lit(face.xy, texelFetch(things, p, 0).r, kind == 192) * shadow(p);
  colour = vec4(${chosen ? "outlined(p, shade)" : "shade"}, 1.0);
}`,
});

/** Light on what was drawn, where nothing is chosen and where something is. */
export const LIGHT = light(false);
export const LIGHT_CHOSEN = light(true);

/** Steps on edges are blended along the edge. */
export const SMOOTH = {
  attributes: [],
  vertex: WHOLE,
  fragment: `${HEAD}
uniform sampler2D image;
out vec4 colour;
float bright(vec3 c) { return dot(c, vec3(0.299, 0.587, 0.114)); }
void main() {
  ivec2 size = textureSize(image, 0);
  ivec2 p = ivec2(gl_FragCoord.xy);
  ivec2 lower = max(p - 1, ivec2(0));
  ivec2 upper = min(p + 1, size - 1);
  vec3 mid = texelFetch(image, p, 0).rgb;
  float m = bright(mid);
  float a = bright(texelFetch(image, lower, 0).rgb);
  float b = bright(texelFetch(image, ivec2(upper.x, lower.y), 0).rgb);
  float c = bright(texelFetch(image, ivec2(lower.x, upper.y), 0).rgb);
  float d = bright(texelFetch(image, upper, 0).rgb);
  float low = min(m, min(min(a, b), min(c, d)));
  float high = max(m, max(max(a, b), max(c, d)));
  if (high - low < max(0.05, high * 0.125)) {
    colour = vec4(mid, 1.0);
    return;
  }
  vec2 unit = 1.0 / vec2(size);
  vec2 at = gl_FragCoord.xy * unit;
  vec2 way = vec2(-((a + b) - (c + d)), (a + c) - (b + d));
  float soft = max((a + b + c + d) * 0.03125, 0.0078125);
  way = clamp(way / (min(abs(way.x), abs(way.y)) + soft), -8.0, 8.0) * unit;
  vec3 near = 0.5 * (texture(image, at + way * (1.0 / 3.0 - 0.5)).rgb + texture(image, at + way * (2.0 / 3.0 - 0.5)).rgb);
  vec3 wide = near * 0.5 + 0.25 * (texture(image, at - way * 0.5).rgb + texture(image, at + way * 0.5).rgb);
  float w = bright(wide);
  colour = vec4(w < low || w > high ? near : wide, 1.0);
}`,
};

/** Lines over the picture, hidden by what is before them. */
export const LINES = {
  attributes: ["place", "tint"],
  vertex: `${HEAD}
in vec3 place;
in vec4 tint;
uniform mat4 matrix;
out vec4 shade;
void main() {
  shade = tint;
  gl_Position = matrix * vec4(place, 1.0);
}`,
  fragment: `${HEAD}
in vec4 shade;
uniform sampler2D depths;
out vec4 colour;
void main() {
  if (gl_FragCoord.z > texelFetch(depths, ivec2(gl_FragCoord.xy), 0).r + 1e-6) discard;
  colour = vec4(shade.rgb * shade.a, shade.a);
}`,
};

/** The volume's slice on the plane of the section. */
export const SLICE = {
  attributes: ["place", "share"],
  vertex: `${HEAD}${SHEET}`,
  fragment: `${HEAD}${KIND}
in vec2 at;
uniform sampler2D image;
uniform sampler2D depths;
uniform bool whole;
uniform float level;     // the threshold, as a grey of the slice
uniform bool bodies;     // faces tell what is material
out vec4 colour;
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy);
  if (gl_FragCoord.z > texelFetch(depths, p, 0).r + 1e-6) discard;
  int kind = kindOf(texelFetch(faces, p, 0));
  vec3 grey = texture(image, at).rgb;
  // a line of sight that meets no surface behind the plane is in material all the way, or in air
  bool material = bodies && kind != 0 ? kind == 128 : grey.r >= level;
  if (!whole && !material) discard;
  colour = vec4(grey, 1.0);
}`,
};

/** Material at the faces of the volume, where no surface is seen. */
export const FILL = {
  attributes: ["place", "share"],
  vertex: `${HEAD}${SHEET}`,
  fragment: `${HEAD}${KIND}
in vec2 at;
in float beyond;
uniform sampler2D mask;
uniform vec3 cut;
out vec4 colour;
void main() {
  bool free = kindOf(texelFetch(faces, ivec2(gl_FragCoord.xy), 0)) == 0;
  // the mask is coarse: beside an opening most of what is seen through is the material at its rim
  if (!free || beyond > 0.0 || texture(mask, at).r < 0.1) discard;
  colour = vec4(cut, 1.0);
}`,
};

/** The depth of one pixel, as bits of a number. */
export const PROBE = {
  attributes: [],
  vertex: WHOLE,
  fragment: `${HEAD}
uniform sampler2D depths;
uniform ivec2 pixel;
out uint bits;
void main() { bits = floatBitsToUint(texelFetch(depths, pixel, 0).r); }`,
};
