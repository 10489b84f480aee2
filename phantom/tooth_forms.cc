// The fourteen kinds of crown. Millimetres; sizes after Wheeler's tables. Heights of relief points are told
// from the top of the crown downwards.
#include <utility>

#include "core/check.h"
#include "phantom/tooth.h"

namespace gnathion {
namespace {

CrownProfile times(double s, const CrownProfile& p) {
  CrownProfile out = p;
  for (double& x : out) x *= s;
  return out;
}

// Relief points below the top, turned into heights over the cervix.
std::vector<ReliefPoint> below(double height, std::vector<ReliefPoint> points) {
  for (ReliefPoint& p : points) p.w_mm += height;
  return points;
}

ToothForm upper_central() {
  ToothForm f;
  f.tooth_class = ToothClass::kIncisor;
  f.height_mm = 10.6;
  f.mesial_mm = {3.15, 3.7, 4.02, 4.2, 4.29, 4.3, 4.12};
  f.distal_mm = {3.05, 3.55, 3.95, 4.2, 4.3, 4.2, 3.75};
  f.buccal_mm = {3.0, 3.5, 3.42, 3.1, 2.6, 1.95, 1.15};
  f.lingual_mm = {-2.9, -3.4, -2.75, -1.7, -0.95, -0.4, 0.05};
  f.squareness_cervix = 2.1;
  f.squareness_top = 3.2;
  f.lingual_taper = 0.28;
  f.bend_per_mm = 0.022;
  f.edge_round_mm = 0.5;
  f.edge_distal_slope = 0.05;
  f.edge_mesial_slope = 0.01;
  f.corner_mesial_mm = 0.6;
  f.corner_distal_mm = 1.1;
  f.mamelon_mm = 0.03;
  f.fossa_depth_mm = 0.85;
  f.fossa_half_width_mm = 3.4;
  f.fossa_from = 0.24;
  f.fossa_to = 1.06;
  f.face_grooves = {{1.35, true, 0.10, 0.8, 0.35, 0.95}, {-1.45, true, 0.10, 0.8, 0.35, 0.95}};
  f.reference = {0.0, 0.45, 10.6};
  f.margin_buccal_mm = 0.3;
  f.margin_lingual_mm = 0.9;
  f.papilla_mm = 4.6;
  return f;
}

ToothForm upper_lateral() {
  ToothForm f = upper_central();
  f.height_mm = 9.2;
  f.mesial_mm = {2.25, 2.65, 2.95, 3.15, 3.25, 3.25, 3.05};
  f.distal_mm = {2.15, 2.6, 2.95, 3.2, 3.25, 3.05, 2.5};
  f.buccal_mm = {2.6, 3.0, 2.98, 2.7, 2.25, 1.7, 1.0};
  f.lingual_mm = {-2.6, -3.1, -2.65, -1.75, -1.0, -0.45, 0.0};
  f.lingual_taper = 0.24;
  f.bend_per_mm = 0.045;
  f.edge_distal_slope = 0.13;
  f.corner_mesial_mm = 0.7;
  f.corner_distal_mm = 1.4;
  f.fossa_depth_mm = 0.8;
  f.fossa_half_width_mm = 2.5;
  f.face_grooves = {{1.0, true, 0.08, 0.6, 0.35, 0.95}, {-1.0, true, 0.08, 0.6, 0.35, 0.95}};
  f.reference = {0.0, 0.4, 9.2};
  f.papilla_mm = 4.0;
  return f;
}

ToothForm upper_canine() {
  ToothForm f;
  f.tooth_class = ToothClass::kCanine;
  f.height_mm = 10.2;
  f.mesial_mm = {2.75, 3.15, 3.45, 3.65, 3.75, 3.6, 3.1};
  f.distal_mm = {2.7, 3.15, 3.5, 3.75, 3.8, 3.45, 2.7};
  f.buccal_mm = {3.55, 4.1, 4.1, 3.75, 3.15, 2.4, 1.45};
  f.lingual_mm = {-3.5, -4.0, -3.5, -2.4, -1.45, -0.75, -0.15};
  f.squareness_cervix = 2.05;
  f.squareness_top = 2.15;
  f.lingual_taper = 0.3;
  f.bend_per_mm = 0.055;
  f.edge_round_mm = 0.55;
  f.edge_tip_u_mm = 0.25;
  f.edge_mesial_slope = 0.52;
  f.edge_distal_slope = 0.62;
  f.edge_tip_round_mm = 0.45;
  f.corner_mesial_mm = 0.5;
  f.corner_distal_mm = 0.9;
  f.fossa_depth_mm = 0.65;
  f.fossa_half_width_mm = 2.9;
  f.fossa_from = 0.26;
  f.fossa_to = 1.0;
  f.lingual_ridge_mm = 0.5;
  f.face_grooves = {{1.7, true, 0.10, 0.7, 0.35, 0.95}, {-1.6, true, 0.14, 0.8, 0.35, 0.95}};
  f.reference = {0.25, 0.55, 10.2};
  f.margin_buccal_mm = 0.1;
  f.margin_lingual_mm = 0.8;
  f.papilla_mm = 3.6;
  return f;
}

// Upper premolars: rim mesially from the buccal tip round to it again, then the feet of the triangular
// ridges.
ToothForm upper_premolar(bool first) {
  ToothForm f;
  f.tooth_class = ToothClass::kPremolar;
  f.height_mm = first ? 8.4 : 8.0;
  const double h = f.height_mm;
  const double lingual_drop = first ? -0.95 : -0.35;
  f.mesial_mm = times(3.5, {0.72, 0.84, 0.93, 0.985, 1.0, 0.95, 0.84});
  f.distal_mm = times(3.5, {0.72, 0.85, 0.95, 1.0, 1.0, 0.94, 0.82});
  f.buccal_mm = {3.95, 4.45, 4.5, 4.3, 3.95, 3.45, 2.75};
  f.lingual_mm = {-3.95, -4.3, -4.5, -4.5, -4.3, -3.85, -3.1};
  f.squareness_cervix = 2.25;
  f.squareness_top = 2.7;
  f.lingual_taper = first ? 0.2 : 0.12;
  f.edge_round_mm = 0.8;
  f.points = below(h, {{first ? -0.2 : 0.1, 2.5, 0.0},  // 0 buccal tip
                       {2.35, 1.55, -1.45},             // 1 mesial end of the buccal cusp ridge
                       {2.75, 0.1, -1.75},              // 2 mesial marginal ridge
                       {2.05, -1.65, -1.65},            // 3
                       {0.45, -2.65, lingual_drop},     // 4 palatal tip
                       {-1.9, -1.7, -1.75},             // 5
                       {-2.75, 0.0, -1.85},             // 6 distal marginal ridge
                       {-2.35, 1.5, -1.55},             // 7
                       {0.0, 0.15, -2.35},              // 8 foot of the buccal triangular ridge
                       {0.15, -0.45, -2.4}});           // 9 foot of the palatal one
  f.ridges = {{0, 1, 1.25, 0.8, 0.1},  {1, 2, 1.3, 0.9, 0.0},  {2, 3, 1.3, 0.9, 0.0}, {3, 4, 1.25, 0.8, 0.1},
              {4, 5, 1.25, 0.8, 0.1},  {5, 6, 1.3, 0.9, 0.0},  {6, 7, 1.3, 0.9, 0.0}, {7, 0, 1.25, 0.8, 0.1},
              {0, 8, 1.15, 0.9, 0.25}, {4, 9, 1.15, 0.9, 0.25}};
  const double reach = first ? 1.9 : 1.35;
  f.fissures = {{{{reach, 0.0}, {0.0, -0.15}, {-reach, -0.05}}, 0.4, 0.75},
                {{{reach, 0.0}, {reach + 0.45, 0.9}}, 0.25, 0.6},
                {{{reach, 0.0}, {reach + 0.25, -0.9}}, 0.2, 0.6},
                {{{-reach, -0.05}, {-reach - 0.45, 0.8}}, 0.25, 0.6},
                {{{-reach, -0.05}, {-reach - 0.25, -0.9}}, 0.2, 0.6}};
  if (first) f.fissures.push_back({{{reach, 0.0}, {3.6, -0.1}}, 0.3, 0.6});  // the mesial marginal groove
  f.functional_cusps = {4};
  f.floor_mm = h - 2.7;
  f.face_grooves = {{1.7, true, 0.12, 0.7, 0.5, 1.1}, {-1.7, true, 0.12, 0.7, 0.5, 1.1}};
  f.reference = {0.0, 0.0, h - 2.3};
  f.margin_buccal_mm = 0.4;
  f.margin_lingual_mm = 0.7;
  f.papilla_mm = 2.6;
  return f;
}

// Upper molars: four cusps, the oblique ridge from the mesiopalatal to the distobuccal one.
ToothForm upper_molar(bool first) {
  ToothForm f;
  f.tooth_class = ToothClass::kMolar;
  f.height_mm = first ? 7.6 : 7.2;
  const double h = f.height_mm, s = first ? 1.0 : 0.88;
  f.mesial_mm = times(5.2 * s, {0.75, 0.84, 0.92, 0.98, 1.0, 0.96, 0.87});
  f.distal_mm = times(5.2 * s, {0.75, 0.85, 0.94, 0.99, 1.0, 0.94, 0.84});
  f.buccal_mm = times(first ? 1.0 : 0.98, {4.75, 5.35, 5.45, 5.25, 4.9, 4.35, 3.6});
  f.lingual_mm = times(first ? 1.0 : 0.98, {-4.8, -5.2, -5.5, -5.55, -5.35, -4.85, -4.0});
  f.squareness_cervix = 2.5;
  f.squareness_top = 3.4;
  f.lingual_taper = first ? 0.03 : 0.12;
  f.skew = first ? -0.12 : -0.17;
  f.edge_round_mm = 0.75;
  const double dl = first ? -0.9 : -1.35;
  f.points = below(h, {{2.25 * s, 3.1, -0.1},      // 0 mesiobuccal
                       {0.15, 2.9, -1.25},         // 1 notch of the buccal groove
                       {-2.05 * s, 2.95, -0.3},    // 2 distobuccal
                       {-4.0 * s, 1.5, -1.35},     // 3
                       {-4.25 * s, -0.4, -1.65},   // 4 distal marginal ridge
                       {-3.75 * s, -2.2, -1.35},   // 5
                       {-2.9 * s, -3.2, dl},       // 6 distopalatal
                       {-1.55 * s, -3.45, -1.75},  // 7 notch of the palatal groove
                       {0.85 * s, -3.15, -0.05},   // 8 mesiopalatal
                       {3.0 * s, -2.3, -1.25},     // 9
                       {4.1 * s, -0.1, -1.55},     // 10 mesial marginal ridge
                       {3.95 * s, 1.75, -1.3},     // 11
                       {1.0 * s, 0.75, -2.35},     // 12 foot of the mesiobuccal ridge
                       {1.2 * s, -0.35, -2.4},     // 13 foot of the mesiopalatal ridge
                       {-0.9 * s, 0.0, -1.55},     // 14 middle of the oblique ridge
                       {-2.7 * s, -1.3, -2.2},     // 15 foot of the distopalatal ridge
                       {0.55 * s, 0.35, -2.5}});   // 16 central pit
  f.ridges = {{0, 1, 1.2, 0.9, 0.15},  {1, 2, 1.2, 0.9, 0.15},  {2, 3, 1.2, 0.9, 0.1},
              {3, 4, 1.25, 1.1, 0.0},  {4, 5, 1.25, 1.1, 0.0},  {5, 6, 1.2, 0.9, 0.1},
              {6, 7, 1.2, 0.9, 0.1},   {7, 8, 1.2, 0.9, 0.2},   {8, 9, 1.2, 0.9, 0.15},
              {9, 10, 1.25, 1.1, 0.0}, {10, 11, 1.25, 1.1, 0},  {11, 0, 1.2, 0.9, 0.1},
              {0, 12, 1.15, 1.1, 0.3}, {8, 13, 1.15, 1.1, 0.3}, {8, 14, 1.15, 1.1, 0.1},
              {2, 14, 1.15, 1.1, 0.1}, {6, 15, 1.15, 1.1, 0.25}};
  f.fissures = {
      {{{3.1 * s, 0.1}, {1.8 * s, 0.15}, {0.55 * s, 0.35}, {-0.4 * s, 0.9}}, 0.4, 0.75},  // central groove
      {{{0.55 * s, 0.35}, {0.3, 1.8}, {0.15, 3.6}}, 0.4, 0.75},                           // buccal groove
      {{{-3.2 * s, 0.5}, {-2.5 * s, -0.4}, {-1.9 * s, -1.9}, {-1.55 * s, -3.8}},
       0.45,
       0.5},  // palatal groove
      {{{3.1 * s, 0.1}, {3.5 * s, 1.1}}, 0.25, 0.6},
      {{{3.1 * s, 0.1}, {3.4 * s, -0.9}}, 0.25, 0.6},
      {{{-3.2 * s, 0.5}, {-3.5 * s, 1.2}}, 0.2, 0.6}};
  f.functional_cusps = {8, 6};
  f.floor_mm = h - 2.75;
  f.face_grooves = {{0.1, true, 0.5, 0.95, 0.3, 1.1}, {-1.5 * s, false, 0.45, 0.9, 0.35, 1.1}};
  f.reference = {0.0, 0.2, h - 2.3};
  f.central_fossa = 16;
  f.margin_buccal_mm = 0.5;
  f.margin_lingual_mm = 0.7;
  f.papilla_mm = 2.2;
  return f;
}

ToothForm lower_incisor(bool central) {
  ToothForm f;
  f.tooth_class = ToothClass::kIncisor;
  f.height_mm = central ? 9.0 : 9.2;
  const double s = central ? 1.0 : 1.09;
  f.mesial_mm = times(s, {1.7, 2.0, 2.26, 2.46, 2.57, 2.62, 2.6});
  f.distal_mm = times(s, {1.65, 2.0, 2.28, 2.48, 2.59, 2.64, central ? 2.6 : 2.5});
  f.buccal_mm = {2.45, 2.85, 2.75, 2.4, 2.0, 1.5, 0.9};
  f.lingual_mm = {-2.6, -2.95, -2.55, -1.75, -1.05, -0.5, -0.05};
  f.squareness_cervix = 2.1;
  f.squareness_top = 3.0;
  f.lingual_taper = 0.2;
  f.bend_per_mm = 0.03;
  f.edge_round_mm = 0.45;
  f.edge_distal_slope = central ? 0.01 : 0.05;
  f.corner_mesial_mm = 0.35;
  f.corner_distal_mm = central ? 0.4 : 0.6;
  f.mamelon_mm = 0.025;
  f.fossa_depth_mm = 0.3;
  f.fossa_half_width_mm = 2.1;
  f.fossa_from = 0.3;
  f.fossa_to = 1.0;
  f.reference = {0.0, 0.35, f.height_mm};
  f.margin_buccal_mm = 0.3;
  f.margin_lingual_mm = 0.6;
  f.papilla_mm = 3.6;
  return f;
}

ToothForm lower_canine() {
  ToothForm f = upper_canine();
  f.height_mm = 10.8;
  f.mesial_mm = {2.6, 2.95, 3.15, 3.3, 3.4, 3.35, 3.0};
  f.distal_mm = {2.5, 2.9, 3.2, 3.4, 3.5, 3.3, 2.6};
  f.buccal_mm = {3.45, 3.95, 3.85, 3.45, 2.9, 2.2, 1.35};
  f.lingual_mm = {-3.35, -3.75, -3.3, -2.4, -1.55, -0.85, -0.25};
  f.edge_tip_u_mm = 0.35;
  f.edge_mesial_slope = 0.38;
  f.edge_distal_slope = 0.55;
  f.fossa_depth_mm = 0.4;
  f.fossa_half_width_mm = 2.6;
  f.lingual_ridge_mm = 0.25;
  f.reference = {0.35, 0.45, 10.8};
  f.papilla_mm = 3.4;
  return f;
}

ToothForm lower_first_premolar() {
  ToothForm f;
  f.tooth_class = ToothClass::kPremolar;
  f.height_mm = 8.6;
  const double h = f.height_mm;
  f.mesial_mm = times(3.5, {0.70, 0.82, 0.92, 0.98, 1.0, 0.95, 0.82});
  f.distal_mm = times(3.5, {0.71, 0.84, 0.95, 1.0, 1.0, 0.94, 0.8});
  f.buccal_mm = {3.2, 3.75, 3.85, 3.6, 3.1, 2.4, 1.55};
  f.lingual_mm = {-3.3, -3.6, -3.85, -3.95, -3.85, -3.5, -2.9};
  f.squareness_cervix = 2.2;
  f.squareness_top = 2.2;
  f.lingual_taper = 0.3;
  f.edge_round_mm = 0.75;
  f.points = below(h, {{0.15, 1.15, 0.0},       // 0 buccal tip, over the middle of the crown
                       {2.4, 0.65, -1.5},       // 1
                       {2.6, -0.9, -2.3},       // 2 mesial marginal ridge
                       {1.45, -2.35, -2.75},    // 3
                       {0.1, -2.7, -2.45},      // 4 lingual tip, small
                       {-1.5, -2.35, -2.6},     // 5
                       {-2.65, -0.8, -2.0},     // 6 distal marginal ridge
                       {-2.45, 0.6, -1.5},      // 7
                       {0.05, -1.35, -2.55}});  // 8 foot of the transverse ridge
  f.ridges = {{0, 1, 1.25, 0.9, 0.1}, {1, 2, 1.3, 0.9, 0.0}, {2, 3, 1.3, 0.9, 0.0}, {3, 4, 1.2, 0.8, 0.0},
              {4, 5, 1.2, 0.8, 0.0},  {5, 6, 1.3, 0.9, 0.0}, {6, 7, 1.3, 0.9, 0.0}, {7, 0, 1.25, 0.9, 0.1},
              {0, 8, 1.15, 1.1, 0.3}, {4, 8, 1.2, 0.9, 0.0}};
  f.fissures = {{{{1.5, -0.7}, {1.15, -1.6}}, 0.45, 0.75},
                {{{-1.5, -0.6}, {-1.2, -1.5}}, 0.5, 0.6},
                {{{1.15, -1.6}, {1.35, -3.2}}, 0.3, 0.6},  // the mesiolingual groove
                {{{-1.2, -1.5}, {0.05, -1.75}, {1.15, -1.6}}, 0.2, 0.6}};
  f.functional_cusps = {0};
  f.floor_mm = h - 3.3;
  f.face_grooves = {{1.6, true, 0.1, 0.7, 0.5, 1.1}, {-1.6, true, 0.1, 0.7, 0.5, 1.1}};
  f.reference = {0.15, 1.15, h};
  f.margin_buccal_mm = 0.3;
  f.margin_lingual_mm = 0.5;
  f.papilla_mm = 2.6;
  return f;
}

// Lower second premolar of the three-cusp kind: fissures in a Y.
ToothForm lower_second_premolar() {
  ToothForm f = lower_first_premolar();
  f.height_mm = 8.0;
  const double h = f.height_mm;
  f.mesial_mm = times(3.55, {0.72, 0.84, 0.93, 0.985, 1.0, 0.96, 0.85});
  f.distal_mm = times(3.55, {0.72, 0.85, 0.95, 1.0, 1.0, 0.95, 0.84});
  f.buccal_mm = {3.45, 4.0, 4.1, 3.85, 3.4, 2.8, 2.05};
  f.lingual_mm = {-3.5, -3.85, -4.1, -4.15, -4.05, -3.7, -3.05};
  f.squareness_top = 2.9;
  f.lingual_taper = 0.06;
  f.points = below(h, {{0.2, 1.75, 0.0},        // 0 buccal tip
                       {2.45, 1.05, -1.35},     // 1
                       {2.75, -0.4, -1.7},      // 2 mesial marginal ridge
                       {2.35, -1.7, -1.35},     // 3
                       {1.1, -2.45, -0.75},     // 4 mesiolingual tip
                       {-0.55, -2.6, -1.6},     // 5 notch of the lingual groove
                       {-1.65, -2.3, -1.15},    // 6 distolingual tip
                       {-2.75, -0.5, -1.8},     // 7 distal marginal ridge
                       {-2.45, 1.0, -1.4},      // 8
                       {0.1, -0.1, -2.2},       // 9 feet of the triangular ridges
                       {0.55, -0.85, -2.25},    // 10
                       {-1.0, -0.85, -2.25}});  // 11
  f.ridges = {{0, 1, 1.25, 0.9, 0.1},  {1, 2, 1.3, 0.9, 0.0},   {2, 3, 1.3, 0.9, 0.0},
              {3, 4, 1.25, 0.8, 0.05}, {4, 5, 1.25, 0.8, 0},    {5, 6, 1.25, 0.8, 0},
              {6, 7, 1.3, 0.9, 0.0},   {7, 8, 1.3, 0.9, 0.0},   {8, 0, 1.25, 0.9, 0.1},
              {0, 9, 1.15, 0.9, 0.3},  {4, 10, 1.15, 0.9, 0.2}, {6, 11, 1.15, 0.9, 0.2}};
  f.fissures = {{{{1.7, -0.25}, {0.2, -0.5}, {-0.35, -0.6}, {-1.8, -0.2}}, 0.4, 0.75},
                {{{-0.35, -0.6}, {-0.5, -1.7}, {-0.55, -3.1}}, 0.4, 0.75},
                {{{1.7, -0.25}, {2.1, 0.5}}, 0.25, 0.6},
                {{{1.7, -0.25}, {2.05, -1.0}}, 0.2, 0.6},
                {{{-1.8, -0.2}, {-2.1, 0.6}}, 0.25, 0.6}};
  f.floor_mm = h - 2.6;
  f.reference = {0.1, 1.75, h};
  f.papilla_mm = 2.4;
  return f;
}

// Lower first molar: five cusps, three of them buccal.
ToothForm lower_first_molar() {
  ToothForm f;
  f.tooth_class = ToothClass::kMolar;
  f.height_mm = 7.6;
  const double h = f.height_mm;
  f.mesial_mm = times(5.6, {0.77, 0.85, 0.93, 0.985, 1.0, 0.96, 0.87});
  f.distal_mm = times(5.6, {0.75, 0.84, 0.93, 0.99, 1.0, 0.95, 0.85});
  f.buccal_mm = {4.55, 5.1, 5.2, 4.95, 4.5, 3.9, 3.1};
  f.lingual_mm = {-4.4, -4.75, -5.05, -5.15, -5.05, -4.65, -3.95};
  f.squareness_cervix = 2.6;
  f.squareness_top = 3.5;
  f.lingual_taper = 0.09;
  f.edge_round_mm = 0.75;
  f.points = below(h, {{2.75, 2.6, -0.15},     // 0 mesiobuccal
                       {1.05, 2.75, -1.2},     // 1 notch of the mesiobuccal groove
                       {-0.7, 2.75, -0.25},    // 2 distobuccal
                       {-2.35, 2.3, -1.3},     // 3 notch of the distobuccal groove
                       {-3.65, 1.55, -0.75},   // 4 distal
                       {-4.6, -0.2, -1.65},    // 5 distal marginal ridge
                       {-4.0, -1.9, -1.3},     // 6
                       {-2.15, -3.05, -0.1},   // 7 distolingual
                       {-0.05, -3.05, -1.35},  // 8 notch of the lingual groove
                       {2.25, -3.1, 0.0},      // 9 mesiolingual
                       {4.1, -1.8, -1.15},     // 10
                       {4.6, 0.0, -1.5},       // 11 mesial marginal ridge
                       {4.2, 1.6, -1.2},       // 12
                       {1.45, 0.35, -2.25},    // 13 feet of the triangular ridges: mesiobuccal
                       {-0.75, 0.55, -2.2},    // 14 distobuccal
                       {-2.7, 0.35, -2.0},     // 15 distal
                       {1.15, -0.65, -2.3},    // 16 mesiolingual
                       {-1.35, -0.65, -2.25},  // 17 distolingual
                       {0.15, -0.1, -2.5}});   // 18 central pit
  f.ridges = {{0, 1, 1.2, 0.9, 0.12},   {1, 2, 1.2, 0.9, 0.12},  {2, 3, 1.2, 0.9, 0.12},
              {3, 4, 1.2, 0.9, 0.05},   {4, 5, 1.25, 1.1, 0.0},  {5, 6, 1.25, 1.1, 0.0},
              {6, 7, 1.2, 0.9, 0.12},   {7, 8, 1.2, 0.9, 0.12},  {8, 9, 1.2, 0.9, 0.12},
              {9, 10, 1.2, 0.9, 0.1},   {10, 11, 1.25, 1.1, 0},  {11, 12, 1.25, 1.1, 0},
              {12, 0, 1.2, 0.9, 0.1},   {0, 13, 1.15, 1.1, 0.3}, {2, 14, 1.15, 1.1, 0.3},
              {4, 15, 1.15, 0.9, 0.15}, {9, 16, 1.15, 1.1, 0.3}, {7, 17, 1.15, 1.1, 0.3}};
  f.fissures = {{{{3.5, -0.1}, {1.3, -0.2}, {0.15, -0.1}, {-1.7, -0.1}, {-3.6, -0.25}}, 0.4, 0.75},
                {{{0.85, -0.15}, {0.95, 1.5}, {1.05, 3.3}}, 0.4, 0.75},
                {{{-1.7, -0.1}, {-2.1, 1.2}, {-2.45, 2.9}}, 0.4, 0.75},
                {{{-0.1, -0.1}, {-0.05, -1.8}, {-0.05, -3.6}}, 0.4, 0.75},
                {{{3.5, -0.1}, {3.95, 0.85}}, 0.25, 0.6},
                {{{3.5, -0.1}, {3.9, -1.0}}, 0.25, 0.6},
                {{{-3.6, -0.25}, {-3.9, -1.0}}, 0.2, 0.6}};
  f.functional_cusps = {0, 2, 4};
  f.floor_mm = h - 2.75;
  f.face_grooves = {{1.05, true, 0.45, 0.8, 0.3, 1.1},
                    {-2.4, true, 0.35, 0.75, 0.35, 1.1},
                    {-0.05, false, 0.35, 0.85, 0.4, 1.1}};
  f.reference = {0.0, 2.65, h - 0.2};
  f.central_fossa = 18;
  f.margin_buccal_mm = 0.4;
  f.margin_lingual_mm = 0.6;
  f.papilla_mm = 2.2;
  return f;
}

// Lower second molar: four cusps, fissures in a cross.
ToothForm lower_second_molar() {
  ToothForm f = lower_first_molar();
  f.height_mm = 7.2;
  const double h = f.height_mm;
  f.mesial_mm = times(5.3, {0.77, 0.86, 0.94, 0.99, 1.0, 0.96, 0.87});
  f.distal_mm = times(5.2, {0.75, 0.85, 0.94, 0.99, 1.0, 0.95, 0.85});
  f.lingual_taper = 0.04;
  f.points = below(h, {{2.35, 2.65, -0.1},     // 0 mesiobuccal
                       {0.1, 2.7, -1.25},      // 1
                       {-2.2, 2.6, -0.25},     // 2 distobuccal
                       {-3.9, 1.5, -1.3},      // 3
                       {-4.3, -0.1, -1.6},     // 4 distal marginal ridge
                       {-3.8, -1.8, -1.3},     // 5
                       {-2.15, -3.05, -0.2},   // 6 distolingual
                       {0.0, -3.05, -1.3},     // 7
                       {2.2, -3.1, 0.0},       // 8 mesiolingual
                       {3.9, -1.8, -1.2},      // 9
                       {4.3, 0.0, -1.5},       // 10 mesial marginal ridge
                       {3.95, 1.6, -1.25},     // 11
                       {1.15, 0.5, -2.25},     // 12 feet of the triangular ridges
                       {-1.2, 0.45, -2.2},     // 13
                       {1.1, -0.75, -2.3},     // 14
                       {-1.15, -0.75, -2.25},  // 15
                       {0.0, -0.1, -2.5}});    // 16 central pit
  f.ridges = {
      {0, 1, 1.2, 0.9, 0.12},  {1, 2, 1.2, 0.9, 0.12},  {2, 3, 1.2, 0.9, 0.1},   {3, 4, 1.25, 1.1, 0.0},
      {4, 5, 1.25, 1.1, 0.0},  {5, 6, 1.2, 0.9, 0.1},   {6, 7, 1.2, 0.9, 0.12},  {7, 8, 1.2, 0.9, 0.12},
      {8, 9, 1.2, 0.9, 0.1},   {9, 10, 1.25, 1.1, 0},   {10, 11, 1.25, 1.1, 0},  {11, 0, 1.2, 0.9, 0.1},
      {0, 12, 1.15, 1.1, 0.3}, {2, 13, 1.15, 1.1, 0.3}, {8, 14, 1.15, 1.1, 0.3}, {6, 15, 1.15, 1.1, 0.3}};
  f.fissures = {{{{3.2, -0.1}, {1.3, -0.2}, {0.0, -0.1}, {-1.6, -0.2}, {-3.2, -0.1}}, 0.4, 0.75},
                {{{0.0, -0.1}, {0.1, 1.5}, {0.1, 3.3}}, 0.4, 0.75},
                {{{0.0, -0.1}, {0.0, -1.8}, {0.0, -3.6}}, 0.4, 0.75},
                {{{3.2, -0.1}, {3.65, 0.85}}, 0.25, 0.6},
                {{{3.2, -0.1}, {3.6, -1.0}}, 0.25, 0.6},
                {{{-3.2, -0.1}, {-3.6, 0.8}}, 0.2, 0.6}};
  f.functional_cusps = {0, 2};
  f.floor_mm = h - 2.75;
  f.face_grooves = {{0.1, true, 0.45, 0.9, 0.3, 1.1}, {0.0, false, 0.35, 0.85, 0.4, 1.1}};
  f.reference = {0.0, 2.62, h - 0.2};
  f.central_fossa = 16;
  return f;
}

}  // namespace

ToothForm upper_tooth_form(int number) {
  GNATHION_CHECK(number >= 1 && number <= 7);
  switch (number) {
    case 1:
      return upper_central();
    case 2:
      return upper_lateral();
    case 3:
      return upper_canine();
    case 4:
      return upper_premolar(true);
    case 5:
      return upper_premolar(false);
    case 6:
      return upper_molar(true);
    default:
      return upper_molar(false);
  }
}

ToothForm lower_tooth_form(int number) {
  GNATHION_CHECK(number >= 1 && number <= 7);
  switch (number) {
    case 1:
      return lower_incisor(true);
    case 2:
      return lower_incisor(false);
    case 3:
      return lower_canine();
    case 4:
      return lower_first_premolar();
    case 5:
      return lower_second_premolar();
    case 6:
      return lower_first_molar();
    default:
      return lower_second_molar();
  }
}

}  // namespace gnathion
