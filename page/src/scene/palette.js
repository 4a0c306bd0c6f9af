// Colors of the 3D view, for a light and a dark ground. Red, green and blue from 0 to 255.

const rgb = (hex) => [1, 3, 5].map((at) => Number.parseInt(hex.slice(at, at + 2), 16));

const theme = (colors) =>
  Object.fromEntries(
    Object.entries(colors).map(([name, value]) => [name, Array.isArray(value) ? value.map(rgb) : rgb(value)]),
  );

export const PALETTES = {
  dark: theme({
    ground: "#0e1319",
    // Shades of landmarks from the lowest to the highest, in steps of lightness.
    ramp: ["#4d6bd6", "#2c9fd1", "#45c98a", "#f0d24a", "#ff7043"],
    plain: "#7f93a8",
    clients: ["#5ab0ff", "#ffb454", "#c792ea", "#5fd7a7", "#ff8fa3", "#d7d75f", "#7fd7ff", "#e0a080"],
    odometry: "#8b98a7",
    covisibility: "#3f5f80",
    window: "#fff2a8",
    selected: "#ffffff",
    accepted: "#3ddc84",
    provisional: "#ffb000",
    off: "#ff5c5c",
  }),
  light: theme({
    ground: "#f7f9fb",
    ramp: ["#28348f", "#14709e", "#1b7f4c", "#a87900", "#c4361a"],
    plain: "#6d7a88",
    clients: ["#0b62c4", "#a85b00", "#7b2fb5", "#0d7a52", "#c02244", "#6b6b00", "#00779e", "#8a4a2a"],
    odometry: "#7a8794",
    covisibility: "#a9bdd2",
    window: "#b88600",
    selected: "#000000",
    accepted: "#0a8043",
    provisional: "#b06a00",
    off: "#c62828",
  }),
};
