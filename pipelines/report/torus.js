// The tyre as a torus whose tread moves with a shape: quads sorted by depth, on a plain canvas.
const AROUND = 96, ACROSS = 14; // quads around the tyre and around its section
const SECTION = 0.3, WIDTH = 1.25; // radius of the section in radii of the belt, and how it is widened
const TURN = 0.62, TILT = 0.3; // of the view, in rad
const DISTANCE = 7; // of the eye

const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));
const mixed = (from, to, share) => from.map((part, k) => part + (to[k] - part) * share);

/** Where a point of the tyre is seen: across, up, and how near. */
function seen(x, y, z) {
  const across = x * Math.cos(TURN) + z * Math.sin(TURN), back = z * Math.cos(TURN) - x * Math.sin(TURN);
  const up = y * Math.cos(TILT) - back * Math.sin(TILT), near = y * Math.sin(TILT) + back * Math.cos(TILT);
  const scale = DISTANCE / (DISTANCE - near);
  return [across * scale, -up * scale, near];
}

/** A drawing on a canvas; `move` takes the deflection at AROUND even angles, in radii. */
function torus(canvas) {
  const pen = canvas.getContext("2d"), sections = [];
  for (let k = 0; k < ACROSS; k++) {
    const angle = (2 * Math.PI * k) / ACROSS, crown = (1 + Math.cos(angle)) / 2;
    // The tread moves, the rim does not.
    sections.push([1 - SECTION + SECTION * Math.cos(angle), WIDTH * SECTION * Math.sin(angle), crown]);
  }
  function quads(deflection) {
    const points = Array.from({ length: AROUND }, (_, n) => {
      const angle = (2 * Math.PI * n) / AROUND;
      return sections.map(([radius, z, crown]) => {
        const r = radius + crown * deflection[n];
        return seen(r * Math.cos(angle), r * Math.sin(angle), z);
      });
    });
    const found = [];
    for (let n = 0; n < AROUND; n++) for (let k = 0; k < ACROSS; k++) {
      const m = (n + 1) % AROUND, l = (k + 1) % ACROSS;
      const corners = [points[n][k], points[m][k], points[m][l], points[n][l]];
      const [a, b, c, d] = corners;
      // Twice the area as it is seen: what faces away is hidden.
      const facing = (c[0] - a[0]) * (d[1] - b[1]) - (c[1] - a[1]) * (d[0] - b[0]);
      if (facing <= 0) continue;
      const size = Math.hypot(c[0] - a[0], c[1] - a[1], c[2] - a[2]);
      const other = Math.hypot(d[0] - b[0], d[1] - b[1], d[2] - b[2]);
      found.push({
        corners, depth: a[2] + b[2] + c[2] + d[2], light: Math.min(1, (1.3 * facing) / (size * other)),
        share: (deflection[n] + deflection[m]) / 2 * sections[k][2],
      });
    }
    return found.sort((p, q) => p.depth - q.depth);
  }
  return {
    count: AROUND,
    move(deflection, largest) {
      const style = getComputedStyle(document.documentElement);
      const colour = (name) => rgb(style.getPropertyValue(name).trim());
      const rubber = colour("--faint"), above = colour("--ring"), below = colour("--fitted");
      const dark = mixed(rubber, [0, 0, 0], 0.55);
      const half = canvas.width / 2, scale = half / 1.55;
      pen.clearRect(0, 0, canvas.width, canvas.height);
      for (const { corners, light, share } of quads(deflection)) {
        const part = largest ? Math.max(-1, Math.min(1, share / largest)) : 0;
        const tone = mixed(rubber, part > 0 ? above : below, Math.abs(part));
        const lit = mixed(mixed(tone, dark, 0.7), tone, light).map(Math.round);
        pen.fillStyle = pen.strokeStyle = `rgb(${lit.join(", ")})`;
        pen.beginPath();
        for (const [x, y] of corners) pen.lineTo(half + scale * x, half + scale * y);
        pen.closePath();
        pen.fill();
        pen.stroke();
      }
    },
  };
}

window.ringmodal.torus = torus;
